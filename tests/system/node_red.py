"""A real Node-RED 4 on the loopback, headless, with the agent of the demo."""

import contextlib
import http.client
import json
import os
import re
import shutil
import subprocess
import unittest

from browser import Browser
from plant import (BASE, PATIENCE, Agent, PlantTest, Sim, Watcher, free_port, frozen, http_ask, read_text, text_of,
                   wait_for, write_json, write_text)

HERE = os.path.dirname(os.path.abspath(__file__))
CONFIG = os.path.join(HERE, "..", "..", "config")
CONTRIB = os.path.join(CONFIG, "node-red", "contrib")
MODULES = os.path.join(os.environ["NODE_RED"], "node_modules")
SETTINGS = """module.exports = {
  uiHost: "127.0.0.1", uiPort: %d, flowFile: "flows.json", credentialSecret: false, mqttReconnectTime: 500,
  debugMaxLength: 100000, telemetry: { enabled: false }, editorTheme: { tours: false },
  externalModules: { autoInstall: false, palette: { allowInstall: false } },
  logging: { console: { level: "info", metrics: false, audit: false } },
};
"""

needs_node_red = unittest.skipUnless(os.path.isdir(os.path.join(MODULES, "node-red")),
                                     "Node-RED is not there: tests/run.sh fetches it from npm's registry")


class NodeRedTest(Browser, PlantTest):
    def start_demo(self, devices=1, interval_ms=500, change=lambda config: None, broker_conf=""):
        """Starts the programs of config/demo/run.sh with some of its devices. The test controls the PLCs' memory."""
        self.start_broker(broker_conf)
        self.sim = Sim(self.directory, [self.plc(), self.plc("press2", protocol="fx-computer-link")][:devices])
        self.sim.start()
        self.watcher = Watcher(self.broker.port)
        text = read_text(os.path.join(CONFIG, "demo", "agent.json"))
        config = json.loads(text.replace("${DEMO_PORT}", str(self.broker.port))
                            .replace("${DEMO_DIR}", self.directory).replace("${DEMO_HTTP}", "0"))
        for part in ("links", "devices"):
            config[part] = config[part][:devices]
        config["devices"][0]["groups"][0]["interval_ms"] = interval_ms
        config["devices"][0]["timeout_ms"] = 300
        self.metrics = free_port()
        config["http"] = {"listen": f"127.0.0.1:{self.metrics}"}
        change(config)
        self.agent = Agent(self.directory, config)
        self.agent.start()

    def start_node_red(self, flows, contrib=False):
        """Starts Node-RED with this text of flows, and with our own nodes if `contrib`."""
        user = os.path.join(self.directory, "node-red")
        os.mkdir(user)
        if contrib:
            # As `npm install FOLDER` leaves it.
            os.mkdir(os.path.join(user, "node_modules"))
            os.symlink(os.path.abspath(CONTRIB), os.path.join(user, "node_modules", "node-red-contrib-fxagent"))
            write_json(os.path.join(user, "package.json"),
                       {"dependencies": {"node-red-contrib-fxagent": "file:contrib"}})
        else:
            os.symlink(MODULES, os.path.join(user, "node_modules"))
            shutil.copy(os.path.join(MODULES, "..", "package.json"), user)
        write_text(os.path.join(user, "flows.json"), flows)
        self.node_red = None
        self.stack.callback(self.stop_node_red)
        self.launch_node_red()

    def launch_node_red(self):
        user = os.path.join(self.directory, "node-red")
        self.port = free_port()
        write_text(os.path.join(user, "settings.js"), SETTINGS % self.port)
        log = self.stack.enter_context(open(os.path.join(self.directory, "node-red.log"), "a"))
        self.said = lambda: text_of(log.name)
        self.node_red = subprocess.Popen(["node", os.path.join(MODULES, "node-red", "red.js"), "-u", user],
                                         stdout=log, stderr=log, cwd=user, env={**os.environ, "HOME": user})

        def is_there():
            self.assertIsNone(self.node_red.poll(), self.said())
            with contextlib.suppress(OSError, http.client.HTTPException):
                return self.ask("GET", "/flows")[0] == 200
        wait_for("Node-RED", is_there, 60)

    def stop_node_red(self):
        if self.node_red is None:
            return
        child, self.node_red = self.node_red, None
        child.terminate()
        child.wait(PATIENCE)

    def ask(self, method, path, body=None, **headers):
        return http_ask(self.port, path, method, json.dumps(body) if body is not None else None,
                        {"Content-Type": "application/json", **headers})

    def context_of(self, tab, key):
        """Returns a flow's context value of this name; None: nothing yet."""
        status, text = self.ask("GET", f"/context/flow/{tab}/{key}")
        self.assertEqual(status, 200, text)
        answer = json.loads(text)
        if answer.get("format") == "undefined":
            return None
        return answer["msg"] if answer["format"].startswith("string") else json.loads(answer["msg"])

    def stored(self):
        """Returns the number of samples in the agent's store."""
        _, text = http_ask(self.metrics, "/metrics")
        return int(re.search(r'^fxagent_samples_waiting\{place="stored"\} (\d+)$', text, re.M)[1])

    def last_of_an_outage(self, mark):
        """Stops the broker until more samples of press1 wait than the window of 20 in flight. They become history, sent
        along with live samples. Returns the last `seq` of the first history message after `mark`."""
        with frozen(self.broker.process):
            wait_for("a backlog", lambda: self.stored() > 50)
        return self.watcher.wait(f"{BASE}/press1/data/fast/history", since=mark)["rows"][-1]["seq"]

    def assert_no_trouble(self):
        """Node-RED has logged no error and no unknown node."""
        for trouble in ("[error]", "TypeError", "ReferenceError", "Waiting for missing types"):
            self.assertNotIn(trouble, self.said())
