"""The page: its data over HTTP, and the page itself in Debian's Chromium, with agent, simulator and broker."""

import contextlib
import json
import os
import signal
import threading
import unittest

from browser import Browser, why_no_browser
from plant import PATIENCE, PlantTest, device, free_port, fxagent, http_ask, tcp_link, wait_for, write_text

SCRIPT = "<img src=x onerror=alert(1)><script>alert(1)</script>"


class PagePlant(PlantTest):
    """press1 on a pty, and press2 on a TCP port of the simulator."""

    def begin(self, many=0, http_more=None, yields=False, interval_ms=200, more_tags=(), **more):
        self.port = free_port()
        tcp = free_port()
        tags = [{"name": "temp", "address": "D100", "type": "int16", "scale": 0.1, "unit": "°C", "description": SCRIPT},
                {"name": "evil", "address": "D101", "type": "int16", "unit": SCRIPT},
                {"name": "total", "address": "D110", "type": "int32", "access": "read_write"}]
        tags += [{"name": f"t{n}", "address": f"D{200 + n % 500}", "type": "int16"} for n in range(many)]
        tags += more_tags
        groups = [{"name": "default", "interval_ms": interval_ms}]
        devices = [device(tags=tags, groups=groups, timeout_ms=300),
                   device("press2", "line2", tags=tags[:3], groups=groups, timeout_ms=300)]
        links = [self.serial() | {"allow_yield": yields}, tcp_link(tcp, "line2")]
        self.start(devices=devices, links=links, plcs=[self.plc(baud=0), {"name": "press2", "tcp": tcp}],
                   http={"listen": f"127.0.0.1:{self.port}"} | (http_more or {}), **more)
        self.listening()

    def listening(self):
        self.agent.wait_logged("state=listening")

    def reload(self, change):
        """Applies `change` to the config of the running agent."""
        change(self.agent.config)
        self.agent.write(self.agent.config)
        self.agent.process.send_signal(signal.SIGHUP)

    def get(self, path, host=None):
        """Returns status and body."""
        return http_ask(self.port, path, headers={"Host": host} if host else {})

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
        news = self.until("the fault", lambda news: news["problems"] and news["problems"][0]["place"] == "link line2")
        problem = news["problems"][0]
        self.assertEqual(problem["severity"], "bad")
        self.assertIn("press2 cannot be reached", problem["text"])
        self.assertTrue(problem["cure"])
        self.assertGreater(problem["since"], 0)
        self.assertIn("1 of 2 devices answers", news["works"])
        self.assertTrue([event for event in news["events"] if event["event"] == "device" and "press2" in event["text"]])
        self.sim.clear_faults(plc="press2")
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


class Commands(PagePlant):
    """Commands from the page: POST /api/command."""

    TOKEN = "0123456789abcdef"

    def begin(self, **more):
        token_file = write_text(os.path.join(self.directory, "token"), f"anna {self.TOKEN}\n", 0o600)
        super().begin(http_more={"token_file": token_file}, store={"path": os.path.join(self.directory, "store.db")}, **more)
        self.ready()
        self.until("all well", lambda news: news["works"].startswith("2 of 2") and news["broker"]["connected"])

    def post(self, command, token=TOKEN, **headers):
        """Returns status and body as JSON."""
        headers = {"Content-Type": "application/json", "Authorization": f"Bearer {token}"} | headers
        status, body = http_ask(self.port, "/api/command", "POST", json.dumps(command), headers)
        return status, json.loads(body)

    def write(self, value, id="w1", **more):
        return {"device": "press1", "id": id, "op": "write", "tag": "total", "value": value} | more

    def test_a_command_has_one_result_here_and_on_mqtt(self):
        self.begin()
        status, result = self.post(self.write(70000, by="eve"))
        self.assertEqual((status, result["status"]), (200, "SUCCEEDED"), result)
        self.assertEqual(result["id"], "w1")
        self.assertGreaterEqual(result["t"]["total_ms"], result["t"]["wire_ms"])
        self.assertEqual((self.sim.get("press1", "D110"), self.sim.get("press1", "D111")), (70000 & 0xFFFF, 1))
        same = self.result("w1")
        for one in (same, result):
            del one["t"]["total_ms"]  # until it was handed over, here or there
        self.assertEqual(same, result)
        last = self.until("the command", lambda news: news["last_commands"])["last_commands"][-1]
        self.assertEqual((last["by"], last["target"], last["value"]), ("page:anna", "total", 70000))
        self.assertTrue(last["frames"])
        _, audit, _ = fxagent("audit", self.agent.path)
        self.assertIn("page:anna", audit)
        self.assertNotIn(self.TOKEN, audit + self.agent.logged())

    def test_a_repeated_command_is_not_carried_out(self):
        self.begin()
        self.assertEqual(self.post(self.write(1))[1]["status"], "SUCCEEDED")
        self.sim.set("press1", "D110", 5)
        self.assertEqual(self.post(self.write(1))[1]["status"], "DUPLICATE")
        self.assertEqual(self.sim.get("press1", "D110"), 5)

    def test_a_silent_device_is_named_with_what_to_check(self):
        self.begin()
        self.sim.fault("press2", "silent", count=100000)
        news = self.until("the fault", lambda news: news["problems"] and "does not answer (timeout)" in news["problems"][0]["text"])
        self.assertEqual(news["problems"][0]["place"], "device press2")
        self.assertTrue(news["problems"][0]["cure"])

    def test_what_admission_refuses_is_refused_here(self):
        self.begin()
        for change, reason in (({"device": "nobody"}, "unknown_device"), ({"tag": "none"}, "unknown_tag"), ({"value": "x"}, "bad_value"),
                               ({"op": "explode"}, "bad_op")):
            status, result = self.post(self.write(1, id=reason, **{}) | change)
            self.assertEqual((status, result["status"], result["reason"]), (200, "REJECTED", reason), result)

    def test_a_silent_plc_has_its_honest_result(self):
        self.begin()
        self.sim.fault("press1", "silent", count=100000)
        status, result = self.post(self.write(1))
        self.assertEqual(status, 200)
        self.assertIn(result["status"], ("UNKNOWN_OUTCOME", "FAILED"), result)

    def test_the_page_commands_while_the_broker_is_away(self):
        self.begin()
        self.broker.kill()
        self.until("the fault", lambda news: not news["broker"]["connected"])
        self.assertEqual(self.post(self.write(77))[1]["status"], "SUCCEEDED")
        self.assertEqual(self.sim.get("press1", "D110"), 77)

    def test_results_for_a_broker_that_is_away_are_bounded(self):
        self.begin()
        self.broker.kill()
        self.until("the fault", lambda news: not news["broker"]["connected"])
        reasons = [self.post(self.write(1, id=f"w{number}", tag="none"))[1]["reason"] for number in range(202)]
        self.assertEqual(reasons, ["unknown_tag"] * 200 + ["queue_full"] * 2)
        self.broker.start()
        self.assertEqual(self.result("w199")["reason"], "unknown_tag")
        wait_for("room", lambda: self.post(self.write(77, id=self.next_id()))[1]["status"] == "SUCCEEDED")
        self.assertEqual(self.results("w200"), [])

    def test_strangers_and_other_sites_reach_nothing(self):
        self.begin()
        here = f"127.0.0.1:{self.port}"
        for headers, status in (({"Authorization": "Bearer wrong"}, 401), ({"Authorization": ""}, 401), ({"Origin": "http://evil.example"}, 403),
                                ({"Origin": f"http://{here}", "Sec-Fetch-Site": "cross-site"}, 403), ({"Host": "evil.example"}, 421)):
            self.assertEqual(self.post(self.write(666), **headers)[0], status, headers)
        self.assertEqual(self.post([1])[0], 400)
        self.assertEqual(self.post(self.write(1, note="x" * 70000))[0], 413)
        self.assertEqual(self.sim.get("press1", "D110"), 0)
        self.assertEqual(self.changes(since=0)["last_commands"], [])
        self.assertEqual(self.post(self.write(1), Origin=f"http://{here}", **{"Sec-Fetch-Site": "same-origin"})[1]["status"], "SUCCEEDED")
        self.assertEqual(self.post(self.write(2, id="w2"), **{"Content-Type": "application/x-www-form-urlencoded"})[1]["status"], "SUCCEEDED")

    def test_an_agent_that_stops_leaves_nobody_waiting(self):
        # No poll meets the silence before the write does.
        self.begin(recorder={"path": os.path.join(self.directory, "recordings")}, interval_ms=600_000)
        self.sim.fault("press1", "silent", count=100000)
        answers = []
        asking = threading.Thread(target=lambda: answers.append(self.post(self.write(1))))
        asking.start()
        wait_for("the write on the wire", lambda: any(
            frame["way"] == "out" and "write" in frame["says"]
            for frame in json.loads(self.get("/api/frames?link=0&since=0")[1])["frames"]))
        self.agent.stop()
        asking.join(PATIENCE)
        self.assertFalse(asking.is_alive())
        self.assertIn(answers[0][0], (200, 503), answers)

    def test_the_port_is_freed_and_taken_back(self):
        self.begin(yields=True)
        self.assertEqual(self.post({"device": "line1", "op": "yield", "minutes": 15})[1]["status"], "SUCCEEDED")
        news = self.until("the yield", lambda news: news["links"][0][4] == 1 and news["problems"])
        self.assertIn("page:anna", news["problems"][0]["text"])
        self.assertEqual(self.post(self.write(1))[1]["reason"], "yielded")
        self.assertEqual(self.post({"device": "line1", "op": "resume"})[1]["status"], "SUCCEEDED")
        self.until("the end", lambda news: not news["problems"])

    def test_without_a_token_file_the_page_is_read_only(self):
        PagePlant.begin(self)
        status, body = self.post(self.write(1))
        self.assertEqual(status, 403)
        self.assertIn("http.token_file", body["error"])


class Frames(PagePlant):
    def test_frames_are_explained(self):
        self.begin(recorder={"path": os.path.join(self.directory, "recordings")})
        self.until("values", lambda news: news["values"], groups="0.0")
        status, body = self.get("/api/frames?link=0&since=0")
        self.assertEqual(status, 200)
        first = json.loads(body)
        out = next(frame for frame in first["frames"] if frame["way"] == "out" and frame["fields"])
        self.assertEqual(out["device"], "press1")
        self.assertTrue(out["says"])
        self.assertTrue(bytes.fromhex(out["hex"]))
        later = json.loads(self.get(f"/api/frames?link=0&since={first['next']}")[1])
        self.assertGreaterEqual(later["next"], first["next"])
        self.assertLessEqual(len(later["frames"]), later["next"] - first["next"])

    def test_without_a_recorder_the_cure_is_named(self):
        self.begin()
        status, body = self.get("/api/frames?link=0&since=0")
        self.assertEqual(status, 404)
        self.assertIn("recorder", body)


@unittest.skipIf(why_no_browser(), why_no_browser())
class InChromium(Browser, PagePlant):
    def open(self, view, **more):
        self.do(open=f"http://127.0.0.1:{self.port}/#{view}", **more)

    def begin_at(self, view="now", text="Every device answers", **more):
        """Begins, and opens a view, which shows `text`."""
        self.begin(**more)
        self.browse()
        self.open(view)
        self.see(text)

    def wait_for_two_answers(self, **more):
        """Waits until the page has drawn the time of one more answer of the agent, and then of another."""
        for before in ("before1", "before2"):
            self.do(until=f"(window.{before} ??= pulse.textContent) !== pulse.textContent && pulse.textContent.startsWith('as of')",
                    **more)

    def fill_command(self, target, value):
        """Fills the form of the view Commands and sends it."""
        for number, text in ((3, target), (4, value)):
            self.do(fill=f"label:nth-of-type({number}) input", text=text)
        self.do(click="form.command button")
        self.do(fill="dialog input", text="0123456789abcdef")
        self.do(click="dialog button.main")

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

    def test_the_age_of_a_value_is_that_of_its_last_read_or_change(self):
        self.begin()
        self.browse()
        self.open("values")
        begins = "document.querySelector('.row .age')?.textContent.startsWith('%s ')"
        self.do(until=begins % "read")
        self.reload(lambda config: config["devices"][0]["groups"][0].update(publish="on_change"))
        self.do(until=begins % "same for")
        self.sim.fault("press1", "dead")
        self.do(until=begins % "read")

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
        self.begin_at()
        self.sim.fault("press2", "drop", count=100000)
        self.see("press2 cannot be reached")
        self.see("1 of 2 devices answers")
        self.do(fill="input[type=search]", text="press2 offline")
        self.do(until="[...document.querySelectorAll('td.text')].every((cell) => cell.innerText.includes('press2'))")
        self.sim.clear_faults(plc="press2")
        self.see("Every device answers")

    def test_a_plc_of_another_model_is_named_with_both_models(self):
        self.begin_at()
        self.reload(lambda config: config["devices"][1].update(model="FX2N"))
        cure = "the PLC is an FX3U, but the config says FX2N: set model to FX3U"
        for text in ("press2 is not as configured", cure, "2 of 2 devices answer"):
            self.see(text)
        self.do(until="document.title === '▲ edge7 – fxagent'")
        self.open("lines/line2")
        self.see(cure)

    def test_an_agent_that_ends_is_missed(self):
        self.begin_at()
        self.assertEqual(self.do(until="document.title"), "edge7 – fxagent")
        self.agent.stop()
        self.see("The agent does not answer", allowed=("ERR_CONNECTION_REFUSED",))
        self.do(until="document.title === '■ edge7 – fxagent' && !document.body.innerText.includes('all is well')",
                allowed=("ERR_CONNECTION_REFUSED",))
        self.agent.start()
        self.do(until="!document.body.innerText.includes('The agent does not answer')", allowed=("ERR_CONNECTION_REFUSED",))

    def test_an_agent_that_a_proxy_misses_is_missed(self):
        self.begin_at()
        self.do(until="window.fetch = async () => new Response('<html>502 Bad Gateway</html>', {status: 502}), true")
        self.see("The agent does not answer: HTTP status 502")

    def test_an_agent_whose_config_cannot_be_had_is_missed(self):
        self.begin_at()
        self.do(until="""window.fetch = ((real) => (path, more) => path === '/api/config' && !window.mended
            ? Promise.reject(new TypeError('planted')) : real(path, more))(window.fetch), true""")
        self.reload(lambda config: config["devices"][0]["tags"][0].update(name="warmth"))
        self.do(until="document.title === '■ edge7 – fxagent' && !document.body.innerText.includes('all is well')")
        self.do(until="window.mended = true")
        self.see("Every device answers")
        self.do(until="document.title === 'edge7 – fxagent'")

    def test_an_agent_that_was_missed_once_is_well_again_without_any_change(self):
        self.begin_at()
        # One question fails. From then on nothing has changed for a page that has the last answer.
        self.do(until="""window.fetch = ((real) => async (path, more) => {
            if (!window.failed) { window.failed = true; throw new TypeError('planted'); }
            return path.startsWith('/api/changes?since=0&') ? await real(path, more) : new Response(null, {status: 304});
          })(window.fetch), true""")
        self.do(until="window.failed && document.title === 'edge7 – fxagent' && document.body.innerText.includes('Every device answers')")

    def test_ten_thousand_tags_make_few_rows(self):
        self.begin(many=9994)
        # An agent on a busy machine answers so until its status is new again.
        late = ("503",)
        self.browse()
        self.open("values", allowed=late)
        self.see("10000 tags", allowed=late)
        self.assertLess(self.do(until="document.querySelectorAll('.row').length", allowed=late), 60)
        self.do(fill="input[type=search]", text="t9993", allowed=late)
        self.do(until="document.querySelectorAll('.row').length === 1", allowed=late)
        self.see("1 of 10000 tags", allowed=late)

    def test_a_command_asks_once_more_and_shows_its_result(self):
        token_file = write_text(os.path.join(self.directory, "token"), "anna 0123456789abcdef\n")
        self.begin_at("commands", "Send a command", http_more={"token_file": token_file},
                      recorder={"path": os.path.join(self.directory, "recordings")}, yields=True)
        self.ready()
        self.assertEqual(self.do(axe=True), [])
        for number, text in ((3, "total"), (4, "421")):
            self.do(fill=f"label:nth-of-type({number}) input", text=text)
        self.do(press="Enter")
        self.see("Write 421 to total of press1?")
        self.assertEqual(self.do(axe=True), [])
        self.do(press="Escape")
        self.do(until="!document.querySelector('dialog')")
        self.do(click="form.command button")
        self.do(fill="dialog input", text="wrong")
        self.do(click="dialog button.main", allowed=("401",))
        self.see("Authorization must be Bearer", allowed=("401",))
        self.assertEqual(self.sim.get("press1", "D110"), 0)
        self.do(click="form.command button")
        self.do(fill="dialog input", text="0123456789abcdef")
        self.do(click="dialog button.main")
        self.see("SUCCEEDED")
        self.see("page:anna")
        self.assertEqual(self.sim.get("press1", "D110"), 421)
        self.command(id="cmd-7f3", op="write", tag="total", value=7)
        self.see("cmd-7f3")
        self.assertEqual(self.do(until="[...document.querySelectorAll('tbody tr')].map((row) => row.innerText.includes('page:anna'))"),
                         [False, True], "each command once, the newest first")
        self.open("lines")
        self.see("On the wire")
        self.do(until="document.querySelectorAll('.frame').length > 3")
        self.assertEqual(self.do(axe=True), [])
        self.do(click=".frame:last-child summary")
        self.do(until="document.querySelector('.frame[open] pre')")
        self.do(click="text=Free the port for 15 minutes")
        self.see("Free the port of line1 for 15 minutes?")
        self.do(fill="dialog input", text="0123456789abcdef")
        self.do(click="dialog button.main")
        self.see("Take the port back")
        self.see("yielded")

    def test_a_value_has_all_its_digits_and_a_scaled_one_no_word_orders(self):
        self.begin(more_tags=[{"name": "meter", "address": "D120", "type": "uint32", "scale": 0.01},
                              {"name": "state", "address": "D130", "states": {"0": "stop"}}])
        self.sim.set("press1", "D120", 1234567891 & 0xFFFF)
        self.sim.set("press1", "D121", 1234567891 >> 16)
        self.browse()
        self.open("values")
        self.see("12345678.91")
        self.see("0 (stop)")
        for tag, shown in (("press1 total", "true"), ("press1 meter", "false")):
            self.do(click=f"[aria-label='plot {tag}']")
            self.do(until=f"document.querySelector('.legend')?.innerText.includes('{tag}')")
            self.do(until=f"document.body.innerText.includes('words swapped') === {shown}")

    def test_a_renamed_tag_is_plotted_under_its_new_name(self):
        self.begin_at("values", "6 tags")
        self.do(click="[aria-label='plot press1 temp']")
        self.do(until="document.querySelector('.legend')?.innerText.includes('press1 temp')")
        self.do(click="text=Pause")
        self.reload(lambda config: config["devices"][0]["tags"][0].update(name="warmth", unit="K"))
        self.do(until="document.querySelector('.row').innerText.includes('warmth')")
        self.do(click=".row input")
        self.do(until="/press1 warmth .* K/.test(document.querySelector('.legend')?.innerText)")
        self.do(until="document.querySelector('.plot path').getAttribute('d').includes('L')")

    def test_the_plot_is_still_there_after_another_view(self):
        self.begin_at("values", "6 tags")
        self.do(click="[aria-label='plot press1 temp']")
        self.do(click="text=Lines")
        self.see("Since the start")
        self.do(click="text=Values")
        self.do(until="document.querySelector('.legend')?.innerText.includes('press1 temp')")
        self.see("6 tags")

    def test_the_curve_goes_on_while_other_views_are_shown(self):
        self.begin_at("values", "6 tags")
        self.do(click="[aria-label='plot press1 temp']")
        self.do(click="text=Lines")
        self.see("Since the start")
        self.do(click="text=Commands")
        self.wait_for_two_answers()
        newest = "import('/data.js').then(({data}) => data.history.get('0.0.0').at(-1)[0])"
        before = self.do(until=newest)
        self.do(until=f"{newest}.then((ts) => ts > {before})")
        self.assertEqual(self.do(until="import('/data.js').then(({want}) => [...want.groups])"), ["0.0"], "no others")

    def test_the_curve_has_a_gap_where_the_page_was_hidden(self):
        self.begin_at("values", "6 tags")
        self.do(click="[aria-label='plot press1 temp']")
        self.do(until="/^M[^M]*L[^M]*$/.test(document.querySelector('.plot path')?.getAttribute('d'))")
        self.do(until="Object.defineProperty(document, 'hidden', {value: true, configurable: true}), true")
        newest = self.do(until="import('/data.js').then(({data, refresh}) => refresh().then(() => data.ts))")
        self.until("a later value", lambda news: news["values"]["0.0"][0][1] > newest, groups="0.0")
        self.do(until="Date.now = ((real) => () => real() + 11000)(Date.now), delete document.hidden")
        self.do(until="/^M[^M]*L[^M]*M[^M]*L[^M]*$/.test(document.querySelector('.plot path').getAttribute('d'))")

    def test_the_curve_has_a_gap_where_the_tag_was_bad(self):
        self.begin_at("values", "6 tags")
        self.do(click="[aria-label='plot press2 temp']")
        self.do(until="/^M[^M]*L[^M]*$/.test(document.querySelector('.plot path')?.getAttribute('d'))")
        self.sim.fault("press2", "drop", count=100000)
        self.do(until="document.querySelector('.row.bad')")
        self.sim.clear_faults(plc="press2")
        self.do(until="/L[^M]*M[^M]*L/.test(document.querySelector('.plot path').getAttribute('d'))")

    def test_the_size_of_a_store_is_a_plain_number(self):
        self.begin_at()
        self.assertEqual(self.do(until="import('/words.js').then(({bytes}) => [999, 1000, 999400, 999600, 2e12].map(bytes))"),
                         ["999 bytes", "1.00 kB", "999 kB", "1.00 MB", "2.00 TB"])

    def test_a_reload_takes_the_chosen_link_away(self):
        self.begin()
        self.browse()
        self.open("lines/line2")
        self.do(until="document.querySelector('h2')?.innerText === 'line2'")
        self.see("press2 default")
        self.do(until="""new MutationObserver(() => {
            window.mixed ||= document.querySelector('h2')?.innerText === 'line1' && view.innerText.includes('press2');
          }).observe(view, {childList: true, subtree: true}), true""")
        self.reload(lambda config: (config["links"].pop(), config["devices"].pop()))
        self.do(until="document.querySelector('h2').innerText === 'line1'")
        self.do(until="window.mixed === false")
        self.reload(lambda config: (config["links"].pop(), config["devices"].pop()))
        self.do(until="!document.querySelector('h2')")
        self.wait_for_two_answers()

    def test_a_reload_takes_the_button_of_a_link_away(self):
        token_file = write_text(os.path.join(self.directory, "token"), "0123456789abcdef\n")
        self.begin_at("lines", "Free the port", http_more={"token_file": token_file}, yields=True)
        self.reload(lambda config: config["links"][0].update(allow_yield=False))
        self.do(until="!document.body.innerText.includes('Free the port')")

    def test_a_view_that_fails_does_not_end_the_polling(self):
        self.begin_at("lines", "Since the start")
        self.do(until="import('/data.js').then(({data}) => Boolean(data.devices.get = () => { throw new Error('planted'); }))",
                allowed=("planted",))
        self.wait_for_two_answers(allowed=("planted",))

    def test_an_address_that_names_no_view_shows_the_first(self):
        self.begin()
        self.browse()
        for address in ("%", "lines/%", "constructor"):
            with self.subTest(address=address):
                self.open(address)
                self.see("Every device answers")

    def test_a_plan_of_another_config_is_not_drawn(self):
        self.begin_at()
        self.do(until="""window.fetch = ((real) => async (path, more) => path.startsWith('/api/plan')
            ? (window.planned = Response.json({hash: 'another', groups: [{d: 7, g: 0, exchanges: 1, ms: 1}]})) : await real(path, more))(window.fetch), true""")
        self.do(click="text=Lines")
        self.do(until="window.planned")
        self.wait_for_two_answers()
        self.assertEqual(self.do(until="[document.querySelector('.planned').innerText]"), [""])

    def test_a_plan_that_fails_late_leaves_that_of_the_next_config(self):
        self.begin_at()
        self.do(until="""window.fetch = ((real) => (path, more) => path.startsWith('/api/plan') && !window.fail
            ? new Promise((_, fail) => { window.fail = () => fail(new TypeError('planted')); }) : real(path, more))(window.fetch), true""")
        self.do(click="text=Lines")
        self.do(until="Boolean(window.fail)")
        self.reload(lambda config: config["devices"][0]["groups"][0].update(interval_ms=300))
        planned = "document.querySelector('.planned').innerText"
        self.do(until=f"{planned}.includes('300 ms')")
        self.do(until="window.fail(), true")
        self.wait_for_two_answers()
        self.assertIn("300 ms", self.do(until=planned))

    def test_the_form_writes_arrays_and_explains_a_wrong_number(self):
        token_file = write_text(os.path.join(self.directory, "token"), "0123456789abcdef\n")
        marks = {"name": "marks", "address": "M104", "type": "bool", "count": 8, "access": "read_write"}
        self.begin_at("commands", "Send a command", http_more={"token_file": token_file}, more_tags=[marks])
        self.ready()
        self.fill_command("marks", "on off on off off off off on")
        self.see("SUCCEEDED")
        self.assertEqual([self.sim.get("press1", f"M{number}") for number in range(104, 112)], [1, 0, 1, 0, 0, 0, 0, 1])
        self.fill_command("total", "05")
        self.see("bad_value")

    def test_without_devices_each_view_is_drawn(self):
        token_file = write_text(os.path.join(self.directory, "token"), "0123456789abcdef\n")
        self.begin_at("config", "press1", http_more={"token_file": token_file})
        self.reload(lambda config: (config["links"].clear(), config["devices"].clear()))
        self.do(until="!document.querySelector('details')")
        for view in ("now", "values", "lines", "commands", "config"):
            with self.subTest(view=view):
                self.open(view)
                self.wait_for_two_answers()

    def test_keyboard_alone_is_enough(self):
        self.begin_at("lines", "Since the start")
        self.do(press="Tab")  # to the link that skips the header
        self.do(press="Enter")
        self.do(until="document.activeElement === view && location.hash === '#lines'")
        self.see("Since the start")
        self.open("now")
        self.see("Every device answers")
        for _ in range(3):
            self.do(press="Tab")
        self.do(until="document.activeElement.hash === '#values'")
        self.do(press="Enter")
        self.see("6 tags")


if __name__ == "__main__":
    unittest.main()
