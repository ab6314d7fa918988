#!/usr/bin/python3
"""CPU of the agent with 0, 1, 10 and 100 open pages at 1,000 Modbus TCP devices of 100 registers, polled once a second:
    FXAGENT=build-bench/agent/fxagent FXSIM=build-bench/tests/sim/fxsim tests/bench/pages.py [--devices N] [--seconds N]
A page asks /api/changes once a second, with the values of twelve groups, as a browser with the view Values does. The pages
run in another process; only the agent's CPU is counted, by /proc. Their process takes CPU from the agent, so each number
of pages is measured twice: open at this agent, and open at another one on the same machine. Prints the agent's memory, too.
With BROWSER_MODULES (build/npm/browser) it also prints the first paints of the view Values in Chromium.
"""

import argparse
import http.client
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request

sys.path.insert(0, os.path.join(os.path.dirname(__file__), "..", "support"))
from ports import free_port

TICKS = os.sysconf("SC_CLK_TCK")


def cpu_s(pid):
    with open(f"/proc/{pid}/stat") as stat:
        fields = stat.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def memory_mib(pid):
    with open(f"/proc/{pid}/status") as status:
        return int(next(line for line in status if line.startswith("VmRSS")).split()[1]) / 1024


def page(port, groups, late, end):
    """One open page. Puts the longest wait for an answer into `late`."""
    now = values = events = 0
    while not end.wait(1):
        began = time.monotonic()
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
        connection.request("GET", f"/api/changes?since={now}&values={values}&events={events}&groups={groups}")
        answer = connection.getresponse()
        body = answer.read()
        connection.close()
        if answer.status == 200:
            news = json.loads(body)
            now = values = news["now"]
            events = max([events] + [event["n"] for event in news["events"]])
        late.append(time.monotonic() - began)


def pages(count, port, devices, seconds, out):
    end, late = threading.Event(), []
    threads = []
    for n in range(count):
        groups = ",".join(f"{(n * 12 + i) % devices}.0" for i in range(12))
        threads.append(threading.Thread(target=page, args=(port, groups, late, end)))
        threads[-1].start()
        time.sleep(1 / count)
    time.sleep(seconds)
    end.set()
    for thread in threads:
        thread.join()
    late.sort()
    out.put((len(late), late[len(late) // 2], late[-1]))


def used(agent, seconds):
    """Returns the agent's percent of a core."""
    before = cpu_s(agent.pid)
    time.sleep(seconds)
    return 100 * (cpu_s(agent.pid) - before) / seconds


def with_pages(agent, count, port, devices, seconds):
    """Returns the agent's percent of a core while pages are open at a port, and what pages() says of their answers."""
    out = multiprocessing.Queue()
    other = multiprocessing.Process(target=pages, args=(count, port, devices, seconds + 1, out))
    other.start()
    time.sleep(1)  # until all are open
    percent = used(agent, seconds)
    answers = out.get(timeout=2 * seconds + 60)
    other.join()
    return percent, answers


def first_paints(port, count=5):
    """Returns three lists of milliseconds, each of fresh browser contexts: from the navigation to the first contentful paint
    of /healthz, a line of text, which is what this browser needs itself; the same of the view Values; and until that shows a
    value, which is looked at every 50 ms."""
    here = os.path.dirname(os.path.abspath(__file__))
    script = os.path.join(here, "..", "system", "peers", "browser", "browser.js")
    paint = {"until": "performance.getEntriesByName('first-contentful-paint')[0]?.startTime"}
    commands = [{"open": f"http://127.0.0.1:{port}/healthz"}, paint, {"open": f"http://127.0.0.1:{port}/#values"}, paint,
                {"until": "/\\d/.test(document.querySelector('.row .value')?.textContent) && performance.now()"}] * count
    done = subprocess.run(["node", script, os.path.abspath(os.environ["BROWSER_MODULES"])],
                          input="\n".join(map(json.dumps, commands)), capture_output=True, text=True, check=True)
    answers = [json.loads(line).get("value") for line in done.stdout.splitlines()]
    return [[round(answer) for answer in answers[n::5]] for n in (1, 3, 4)]


def start_servers(directory, devices, seconds, children):
    """Starts a broker and the simulated devices for so many seconds, and adds them to `children`. Returns the port of the
    broker and that of the first device."""
    broker, first = free_port(), 21000
    with open(os.path.join(directory, "broker.conf"), "w") as out:
        out.write(f"listener {broker} 127.0.0.1\nallow_anonymous true\nmax_queued_messages 0\n")
    children.append(subprocess.Popen(["/usr/sbin/mosquitto", "-c", out.name], stderr=subprocess.DEVNULL))
    with open(os.path.join(directory, "sim.json"), "w") as out:
        json.dump({"plcs": [{"name": "d{}", "protocol": "modbus-tcp", "tcp": first, "repeat": devices,
                             "plant": "counter"}]}, out)
    children.append(subprocess.Popen([os.environ["FXSIM"], "--config", out.name, "--seconds", str(seconds)],
                                     stdout=subprocess.DEVNULL))
    time.sleep(3)
    return broker, first


def start(directory, broker, first, devices, http_port, section="http"):
    config = {"agent": {"id": f"bench{http_port}"}, "mqtt": {"servers": [f"mqtt://127.0.0.1:{broker}"]},
              "links": [{"name": f"l{n}", "tcp": {"host": "127.0.0.1", "port": first + n}} for n in range(devices)],
              "devices": [{"name": f"d{n}", "link": f"l{n}", "protocol": "modbus-tcp",
                           "tags": [{"name": f"t{t}", "address": f"hr:{t}", "type": "int16"} for t in range(100)]}
                          for n in range(devices)]}
    if http_port:
        config[section] = {"listen": f"127.0.0.1:{http_port}"}
    path = os.path.join(directory, f"agent{http_port}.json")
    with open(path, "w") as out:
        json.dump(config, out)
    child = subprocess.Popen([os.environ["FXAGENT"], "run", path], stderr=subprocess.DEVNULL)
    time.sleep(8)  # a measurement begins when the first polls are spread over the second
    return child


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--devices", type=int, default=1000)
    parser.add_argument("--seconds", type=int, default=15)
    given = parser.parse_args()
    children = []
    with tempfile.TemporaryDirectory() as directory:
        try:
            http_port = free_port()
            broker, first = start_servers(directory, given.devices, 300 + 12 * given.seconds, children)
            for name, port in (("no http", 0), ("metrics without a page", http_port)):
                without = start(directory, broker, first, given.devices, port, "metrics")
                if port:
                    urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics").read()
                print(f"{name}: {used(without, given.seconds):.1f} % CPU, {memory_mib(without.pid):.1f} MiB")
                without.terminate()
                without.wait()
            agent = start(directory, broker, first, given.devices, http_port)
            children.append(agent)
            other_port = free_port()
            children.append(start(directory, broker, first, 1, other_port))
            print(f"no page: {used(agent, given.seconds):.1f} % CPU, {memory_mib(agent.pid):.1f} MiB")
            for count in (1, 10, 100):
                other, _ = with_pages(agent, count, other_port, 1, given.seconds)
                own, (answers, median, longest) = with_pages(agent, count, http_port, given.devices, given.seconds)
                print(f"{count} pages: {own:.1f} % CPU, at the other agent {other:.1f} %, {memory_mib(agent.pid):.1f} MiB, "
                      f"{answers} answers, p50 {1000 * median:.1f} ms, longest {1000 * longest:.1f} ms")
            if "BROWSER_MODULES" in os.environ:
                line, paints, shown = first_paints(http_port)
                print(f"first paint with {100 * given.devices} tags: {paints} ms, of a line of text {line} ms; "
                      f"values within {shown} ms")
        finally:
            for child in reversed(children):
                child.terminate()
                child.wait()


if __name__ == "__main__":
    main()
