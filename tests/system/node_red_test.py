"""The flow of config/node-red in a real Node-RED 4 with the dashboard's nodes, with the agent of the demo. Only the
broker's port differs. The flow keeps its state in its context, which the test reads through Node-RED's admin
interface.
"""

import os
import unittest

from browser import why_no_browser
from node_red import CONFIG, NodeRedTest, needs_node_red
from plant import BASE, PlantTest, text_of, wait_for

TAB = "fxagent0flow0001"
SET_60 = "fxagent0inject01"


@needs_node_red
class NodeRed(NodeRedTest):
    def start_flow(self):
        flows = text_of(os.path.join(CONFIG, "node-red", "flows.json"))
        self.assertEqual(flows.count('"port": "1883"'), 1, "the demo's")
        self.start_node_red(flows.replace('"port": "1883"', f'"port": "{self.broker.port}"'))

    def context(self, key):
        return self.context_of(TAB, key)

    def tag(self, name, device="press1"):
        return ((self.context("tags") or {}).get(device) or {}).get(name)

    def test_the_flow_shows_values_alarms_results_and_history(self):
        self.start_demo(interval_ms=50)  # an outage of seconds then has a history
        self.start_flow()
        wait_for("a value", lambda: self.tag("zone1"))

        self.sim.set("press1", "D100", 234)
        wait_for("the value that was set", lambda: self.tag("zone1")["value"] == 23.4)

        # Two setpoints, through the button and through a value as sent by the dashboard's field; each has one result.
        self.assertEqual(self.ask("POST", "/inject/" + SET_60)[0], 200)
        wait_for("the result", lambda: self.context("last_result") == "set-point 60: SUCCEEDED, read back 60")
        self.assertEqual(self.sim.get("press1", "D200"), 600)
        self.ask("POST", "/inject/" + SET_60, {"__user_inject_props__": [{"p": "payload", "v": "160", "vt": "str"}]})
        refused = wait_for("the refusal", lambda: (self.context("last_result") or "").startswith("set-point 160: ")
                           and self.context("last_result"))
        self.assertRegex(refused, r"REJECTED \(out_of_range: .*\)")
        results = [r for r in self.watcher.payloads(f"{BASE}/press1/result")]
        self.assertEqual([r["status"] for r in results], ["SUCCEEDED", "REJECTED"])
        self.assertEqual(self.context("pending"), {})

        # The flow receives history and live samples in one sequence, in which no number is missing in the end.
        last = self.last_of_an_outage(self.watcher.mark())
        wait_for("the history", lambda: self.has_all_after(last))

        # Offline, and online again.
        self.assertEqual(self.context("alarms"), {})
        self.sim.stop()
        wait_for("the alarm", lambda: (self.context("alarms") or {}).get("press1", "").startswith("press1 is offline"))
        self.sim.start()
        wait_for("its end", lambda: self.context("alarms") == {})
        self.agent.stop()
        wait_for("the agent's alarm", lambda: self.context("alarms") == {"agent": "the agent is offline: stopped"})
        self.assert_no_trouble()

    @unittest.skipIf(why_no_browser(), why_no_browser())
    def test_the_dashboard_in_chromium(self):
        self.start_demo(devices=2)
        self.start_flow()
        self.browse()
        self.do(open=f"http://127.0.0.1:{self.port}/dashboard/fxagent", width=1100, height=760)
        self.sim.set("press1", "D100", 234)
        self.see("23.4")
        # It shows press1 alone, although press2 has tags of the same names.
        self.do(until="window.other = false,"
                      "window.watch = new MutationObserver(() => other ||= document.body.textContent.includes('56.7')),"
                      "watch.observe(document.body, {subtree: true, childList: true, characterData: true}), true")
        self.sim.set("press2", "D100", 567)
        wait_for("the value of press2", lambda: (self.tag("zone1", "press2") or {}).get("value") == 56.7)
        self.sim.set("press1", "D100", 345)
        self.see("34.5")
        self.do(until="!other && (watch.disconnect(), true)")
        self.do(until="document.querySelector('canvas, svg.chart') !== null")
        self.do(fill="input[inputmode=decimal]", text="65")
        self.do(press="Enter")
        self.see("set-point 65: SUCCEEDED, read back 65")
        self.assertEqual(self.sim.get("press1", "D200"), 650)
        self.sim.fault("press1", "nak", match="write", count=-1)
        self.do(fill="input[inputmode=decimal]", text="70")
        self.do(press="Enter")
        self.see("set-point 70: FAILED")
        self.sim.stop()
        self.see("press1 is offline")

    def has_all_after(self, last):
        """True once the flow has this number, a newer one, and each one between its first and its newest, in order."""
        seqs = [row["seq"] for row in (self.context("rows") or {}).get("press1", [])]
        return last in seqs and seqs[-1] > last and seqs == list(range(seqs[0], seqs[0] + len(seqs)))


class TextForNumber(PlantTest):
    """A value of the wrong type, as sent by forms and flows, is refused with the value to send instead."""

    def test_a_number_that_came_as_text_is_told_what_to_send(self):
        self.start(devices=None)
        self.ready()
        for number, value in ((1, "50"), (2, "1")):
            result = self.reject("bad_value", id=number, op="write", address="D300", value=value, dry_run=True)
            self.assertEqual(result["id"], number)
            self.assertEqual(result["detail"],
                             f'int16 takes a number: send the number {value}, not the text "{value}"')
        self.succeed(id=3, op="write", address="D300", value=50)


if __name__ == "__main__":
    unittest.main()
