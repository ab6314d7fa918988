"""A peer program that prints a JSON object with a `type` in each line, and takes orders as lines of JSON."""

import json
import subprocess
import threading

from plant import PATIENCE


class JsonPeer:
    """The peer, with all that it has printed since its first start. It may be started again."""

    def __init__(self):
        self.messages = []
        self.arrival = threading.Condition()
        self.process = None

    def launch(self, command, log):
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True)
        self.reader = threading.Thread(target=self._read, args=(self.process.stdout,), daemon=True)
        self.reader.start()

    def _read(self, lines):
        for line in lines:
            with self.arrival:
                self.messages.append(json.loads(line))
                self.arrival.notify_all()

    def order(self, **order):
        self.process.stdin.write(json.dumps(order) + "\n")
        self.process.stdin.flush()

    def mark(self):
        with self.arrival:
            return len(self.messages)

    def seen(self, since=0):
        with self.arrival:
            return self.messages[since:]

    def first(self, what, accept, since=0):
        """Returns the first message for which `accept` returns true."""
        def look():
            return next((message for message in self.messages[since:] if accept(message)), None)
        with self.arrival:
            found = self.arrival.wait_for(look, PATIENCE)
        if not found:
            raise AssertionError(f"waited in vain for {what}; the last: {self.messages[-3:]}")
        return found

    def wait(self, kind, accept=lambda message: True, since=0):
        """Returns the first message of this type for which `accept` returns true."""
        return self.first(kind, lambda message: message["type"] == kind and accept(message), since)

    def close(self):
        """Ends the peer, which ends with its orders."""
        self.process.stdin.close()
        self.process.wait()
        self.reader.join()
        self.process.stdout.close()
