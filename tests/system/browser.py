"""A test's own window of Debian's Chromium, which peers/browser/browser.js drives."""

import json
import os
import shutil
import subprocess

from plant import PATIENCE

CHROMIUM = "/usr/bin/chromium"
MODULES = os.environ.get("BROWSER_MODULES", "")
SCRIPT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "peers", "browser", "browser.js")


def why_no_browser():
    """Returns the reason to skip a test; empty: none."""
    if not os.path.exists(CHROMIUM):
        return "there is no " + CHROMIUM
    there = os.path.isdir(os.path.join(MODULES, "node_modules"))
    return "" if there else "the packages of peers/browser could not be had from npm"


class Browser:
    """For a unittest.TestCase."""

    def browse(self):
        """Starts the browser; it ends with the test."""
        self.chromium = subprocess.Popen([shutil.which("node"), SCRIPT, MODULES],
                                         stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.addCleanup(self.leave)

    def leave(self):
        self.chromium.stdin.close()  # ends it
        try:
            self.chromium.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.chromium.kill()
            raise
        self.chromium.stdout.close()

    def do(self, allowed=(), **command):
        """Sends a command of browser.js and returns its value. The page must not have reported anything else than
        `allowed`."""
        self.chromium.stdin.write(json.dumps(command) + "\n")
        self.chromium.stdin.flush()
        answer = json.loads(self.chromium.stdout.readline())
        self.assertNotIn("error", answer, answer.get("error"))
        reports = [text for text in answer["console"] if not any(word in text for word in allowed)]
        self.assertEqual(reports, [])
        return answer["value"]

    def see(self, text, **more):
        """Waits until the page shows a text."""
        self.do(until=f"document.body.innerText.includes({json.dumps(text)})", **more)
