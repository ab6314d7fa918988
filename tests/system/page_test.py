"""The page: its data over HTTP, and the page itself in Debian's Chromium, with agent, simulator and broker."""

import contextlib
import http.client
import json
import os
import shutil
import subprocess
import unittest

from plant import PATIENCE, PlantTest, device, free_port, wait_for

HERE = os.path.dirname(os.path.abspath(__file__))
CHROMIUM = "/usr/bin/chromium"
BROWSER = os.environ.get("BROWSER_MODULES", "")
SCRIPT = "<img src=x onerror=alert(1)><script>alert(1)</script>"


class PagePlant(PlantTest):
    """press1 on a pty, and press2 on a TCP port of the simulator."""

    def begin(self, many=0, **more):
        self.port = free_port()
        tcp = free_port()
        tags = [{"name": "temp", "address": "D100", "type": "int16", "scale": 0.1, "unit": "°C", "description": SCRIPT},
                {"name": "evil", "address": "D101", "type": "int16", "unit": SCRIPT},
                {"name": "total", "address": "D110", "type": "int32"}]
        tags += [{"name": f"t{n}", "address": f"D{200 + n % 500}", "type": "int16"} for n in range(many)]
        groups = [{"name": "default", "interval_ms": 200}]
        devices = [device(tags=tags, groups=groups, timeout_ms=300),
                   device("press2", "line2", tags=tags[:3], groups=groups, timeout_ms=300)]
        links = [self.serial(), {"name": "line2", "tcp": {"host": "127.0.0.1", "port": tcp}}]
        self.start(devices=devices, links=links, plcs=[self.plc(baud=0), {"name": "press2", "tcp": tcp}],
                   http={"listen": f"127.0.0.1:{self.port}"}, **more)
        self.listening()

    def listening(self):
        wait_for("the page", lambda: "state=listening" in self.agent.logged())

    def get(self, path, host=None):
        """Returns status and body."""
        with contextlib.closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE)) as connection:
            connection.request("GET", path, headers={"Host": host} if host else {})
            answer = connection.getresponse()
            return answer.status, answer.read().decode()

    def changes(self, **arguments):
        query = "&".join(f"{key}={value}" for key, value in arguments.items())
        status, body = self.get("/api/changes?" + query)
        return json.loads(body) if status == 200 else None

    def until(self, what, look, **arguments):
        """Returns the first changes for which `look` is true."""
        found = []

        def seen():
            with contextlib.suppress(OSError):
                news = self.changes(since=0, **arguments)
                if news and look(news):
                    found.append(news)
            return bool(found)

        wait_for(what, seen)
        return found[0]


class PageData(PagePlant):
    def test_values_are_those_of_the_plc(self):
        self.begin()
        self.sim.set("press1", "D100", 421)
        news = self.until("the value", lambda news: (news["values"].get("0.0") or [None])[0]
                          and news["values"]["0.0"][0][0] == 42.1, groups="0.0")
        self.assertEqual(news["problems"], [])
        self.sim.set("press1", "D100", 500)
        self.until("the next value", lambda news: news["values"]["0.0"][0][0] == 50, groups="0.0")

    def test_a_lost_device_is_named_with_reason_and_cure(self):
        self.begin()
        self.until("both online", lambda news: news["works"].startswith("2 of 2") and len(news["devices"]) == 2)
        self.sim.fault("press2", "drop", count=100000)
        news = self.until("the fault", lambda news: news["problems"] and news["problems"][0]["place"] == "device press2")
        problem = news["problems"][0]
        self.assertEqual(problem["severity"], "bad")
        self.assertIn("press2 does not answer", problem["text"])
        self.assertTrue(problem["cure"])
        self.assertGreater(problem["since"], 0)
        self.assertIn("1 of 2 devices answers", news["works"])
        self.assertTrue([event for event in news["events"] if event["event"] == "device" and "press2" in event["text"]])
        self.sim.ask(cmd="clear_faults", plc="press2")
        self.until("the recovery", lambda news: not news["problems"])

    def test_a_lost_broker_is_named_and_what_works_is_told(self):
        self.begin()
        self.until("all well", lambda news: not news["problems"] and news["broker"]["connected"])
        self.broker.kill()
        news = self.until("the fault", lambda news: news["problems"])
        self.assertIn("No connection to mqtt://127.0.0.1", news["problems"][0]["text"])
        self.assertIn("2 of 2 devices answer", news["works"])

    def test_a_command_and_its_result_are_shown(self):
        self.begin()
        self.ready()
        result = self.command(op="write", tag="nothing", value=1)
        self.assertEqual(result["status"], "REJECTED")
        news = self.until("the command", lambda news: news["last_commands"])
        self.assertEqual(news["last_commands"][-1]["id"], result["id"])
        self.assertEqual(news["last_commands"][-1]["reason"], "unknown_tag")
        self.assertEqual(news["commands"]["REJECTED"], 1)

    def test_only_our_names_reach_the_page_and_metrics_stay_open(self):
        self.begin()
        for path in ("/", "/app.js", "/api/config", "/api/changes?since=0"):
            self.assertEqual(self.get(path, "evil.example")[0], 421, path)
            self.until("an answer", lambda _: self.get(path, f"127.0.0.1:{self.port}")[0] == 200)
        self.assertEqual(self.get("/metrics", "evil.example")[0], 200)
        for path in ("/..%2f..%2fetc/passwd", "/../../etc/passwd", "/api/../../etc/passwd", "/%00", "/api/config/"):
            status, body = self.get(path)
            self.assertNotIn("root:", body)
            self.assertIn(status, (200, 404), path)
            self.assertTrue(status == 404 or "<title>fxagent" in body, path)

    def test_answers_repeat_nothing_that_has_not_changed(self):
        self.begin()
        news = self.until("both online", lambda news: len(news["devices"]) == 2)
        later = self.changes(since=news["now"], values=news["now"], events=news["events"][-1]["n"])
        self.assertEqual((later or {"devices": {}})["devices"], {})


@unittest.skipUnless(os.path.exists(CHROMIUM), "there is no " + CHROMIUM)
@unittest.skipUnless(os.path.isdir(os.path.join(BROWSER, "node_modules")),
                     "the packages of peers/browser could not be had from npm")
class Browser(PagePlant):
    def browse(self):
        self.chromium = subprocess.Popen([shutil.which("node"), os.path.join(HERE, "peers", "browser", "browser.js"), BROWSER],
                                         stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.addCleanup(self.leave)

    def leave(self):
        self.chromium.stdin.close()  # ends it
        self.chromium.wait(PATIENCE)
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

    def open(self, view, **more):
        self.do(open=f"http://127.0.0.1:{self.port}/#{view}", **more)

    def see(self, text, **more):
        """Waits until the page shows a text."""
        self.do(until=f"document.body.innerText.includes({json.dumps(text)})", **more)

    def test_each_view_shows_the_plant_and_is_accessible(self):
        self.begin()
        self.sim.set("press1", "D100", 421)
        self.browse()
        shown = {"now": "Every device answers", "values": "42.1 °C", "lines": "Since the start", "commands": "No command has arrived",
                 "config": "Devices"}
        for sizes in ({"width": 1280, "height": 800, "scheme": "light"}, {"width": 360, "height": 740, "scheme": "dark"}):
            for view, text in shown.items():
                with self.subTest(view=view, **sizes):
                    self.open(view, **sizes)
                    self.see(text)
                    self.assertEqual(self.do(axe=True), [])
                    self.assertTrue(self.do(until="document.documentElement.scrollWidth <= innerWidth"))

    def test_values_move_can_be_searched_and_plotted(self):
        self.begin()
        self.browse()
        self.open("values")
        self.sim.set("press1", "D100", 421)
        self.see("42.1 °C")
        self.sim.set("press1", "D100", 433)
        self.see("43.3 °C")
        self.do(fill="input[type=search]", text="press2 temp")
        self.do(until="document.querySelectorAll('.row').length === 1")
        self.do(click=".row input")
        self.do(until="document.querySelector('.plot path').getAttribute('d').includes('L')")
        self.do(fill="input[type=search]", text="press1 total")
        self.do(until="document.querySelectorAll('.row').length === 1")
        self.do(click=".row input")
        self.see("words swapped")

    def test_what_is_wrong_is_shown_and_goes_again(self):
        self.begin()
        self.browse()
        self.open("now")
        self.see("Every device answers")
        self.sim.fault("press2", "drop", count=100000)
        self.see("press2 does not answer")
        self.see("1 of 2 devices answers")
        self.do(fill="input[type=search]", text="press2 offline")
        self.do(until="[...document.querySelectorAll('td.text')].every((cell) => cell.innerText.includes('press2'))")
        self.sim.ask(cmd="clear_faults", plc="press2")
        self.see("Every device answers")

    def test_an_agent_that_ends_is_missed(self):
        self.begin()
        self.browse()
        self.open("now")
        self.see("Every device answers")
        self.agent.stop()
        self.see("The agent does not answer", allowed=("ERR_CONNECTION_REFUSED",))
        self.agent.start()
        self.do(until="!document.body.innerText.includes('The agent does not answer')", allowed=("ERR_CONNECTION_REFUSED",))

    def test_ten_thousand_tags_make_few_rows(self):
        self.begin(many=9994)
        self.browse()
        self.open("values")
        self.see("10000 tags")
        self.assertLess(self.do(until="document.querySelectorAll('.row').length"), 60)
        self.do(fill="input[type=search]", text="t9993")
        self.do(until="document.querySelectorAll('.row').length === 1")
        self.see("1 of 10000 tags")

    def test_keyboard_alone_is_enough(self):
        self.begin()
        self.browse()
        self.open("now")
        self.see("Every device answers")
        self.do(press="Tab")  # to the link that skips the header
        self.do(press="Tab")
        self.do(press="Tab")
        self.do(until="document.activeElement.hash === '#values'")
        self.do(press="Enter")
        self.see("6 tags")


if __name__ == "__main__":
    unittest.main()
