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
import threading
import time
import urllib.request

from probe import Usage
from rig import Bench, device, free_port


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
    """Returns the agent's percent of a core and its MiB."""
    usage = Usage(agent.pid)
    time.sleep(seconds)
    now = usage.now()
    return now["cpu_percent"], now["rss_mib"]


def with_pages(agent, count, port, devices, seconds):
    """Returns the agent's percent of a core while pages are open at a port, and what pages() says of their answers."""
    out = multiprocessing.Queue()
    other = multiprocessing.Process(target=pages, args=(count, port, devices, seconds + 1, out))
    other.start()
    time.sleep(1)  # until all are open
    percent, _ = used(agent, seconds)
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


def start(bench, links, devices, **more):
    """Starts an agent with these sections in its config. Returns it when the first polls are spread over the second."""
    child = bench.agent(links, devices, **more)
    time.sleep(8)
    return child


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--devices", type=int, default=1000)
    parser.add_argument("--seconds", type=int, default=15)
    given = parser.parse_args()
    with Bench() as bench:
        plc, found = device(given.devices, plant="counter")
        bench.simulate([plc], 300 + 12 * given.seconds)
        links, devices = bench.links(found), [bench.modbus(name, 100, 1000) for name, _ in found]
        http_port, other_port = free_port(), free_port()
        listen = {"listen": f"127.0.0.1:{http_port}"}
        for name, more in (("no http", {}), ("metrics without a page", {"metrics": listen})):
            without = start(bench, links, devices, **more)
            if more:
                urllib.request.urlopen(f"http://127.0.0.1:{http_port}/metrics").read()
            percent, mib = used(without, given.seconds)
            print(f"{name}: {percent:.1f} % CPU, {mib:.1f} MiB")
            without.terminate()
            without.wait()
        agent = start(bench, links, devices, http=listen)
        start(bench, links[:1], devices[:1], agent={"id": "other", "root": "bench"},
              http={"listen": f"127.0.0.1:{other_port}"})
        percent, mib = used(agent, given.seconds)
        print(f"no page: {percent:.1f} % CPU, {mib:.1f} MiB")
        for count in (1, 10, 100):
            other, _ = with_pages(agent, count, other_port, 1, given.seconds)
            own, (answers, median, longest) = with_pages(agent, count, http_port, given.devices, given.seconds)
            print(f"{count} pages: {own:.1f} % CPU, at the other agent {other:.1f} %, {Usage(agent.pid).now()['rss_mib']:.1f} "
                  f"MiB, {answers} answers, p50 {1000 * median:.1f} ms, longest {1000 * longest:.1f} ms")
        if "BROWSER_MODULES" in os.environ:
            line, paints, shown = first_paints(http_port)
            print(f"first paint with {100 * given.devices} tags: {paints} ms, of a line of text {line} ms; "
                  f"values within {shown} ms")


if __name__ == "__main__":
    main()
