#!/usr/bin/python3
"""Checks the logs of a standby pair, and a trace of its wire, against the rules of the model.

    tests/model/replay.py --quarantine-ms 2000 [--wire TRACE] LOG_A LOG_B

LOG_A and LOG_B are the text logs of members a and b. Lines of the event `pair` count, all others are skipped:

    2026-11-27T10:17:19.783Z info pair role=standby why=start

TRACE is JSON lines: {"t_ms": 1795774639783, "member": "a", "kind": "request"}, or "answer". `t_ms` is UTC of the same
machine as the logs. --slack-ms (100): a log line may be that much later or earlier than its event.

Prints one line per broken rule. Exit status: 0 none, 1 some, 2 wrong usage or an unreadable file.
"""
import argparse
import bisect
import datetime
import json
import re
import sys

LINE = re.compile(r"^(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3})Z \w+ pair (?:.* )?role=(\w+)")
# A member that restarts begins as standby: standby follows every role.
ALLOWED = {
    None: {"standby"},
    "standby": {"standby", "claiming"},
    "claiming": {"standby", "active"},
    "active": {"standby"},
}


def read_roles(lines):
    """Returns [(t_ms, role)] of the `pair` lines. Raises ValueError if there is none."""
    roles = []
    for line in lines:
        if found := LINE.match(line):
            at = datetime.datetime.fromisoformat(found[1]).replace(tzinfo=datetime.timezone.utc)
            roles.append((round(at.timestamp() * 1000), found[2]))
    if not roles:
        raise ValueError("no line of the event `pair`")
    return roles


def read_wire(lines):
    """Returns [(t_ms, member, kind)] in order of time."""
    trace = []
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            event = json.loads(line)
            t_ms, member, kind = float(event["t_ms"]), event["member"], event["kind"]
        except (ValueError, KeyError, TypeError) as fault:
            raise ValueError(f"line {number}: {fault!r}") from fault
        if member not in ("a", "b") or kind not in ("request", "answer"):
            raise ValueError(f"line {number}: member {member!r}, kind {kind!r}")
        trace.append((t_ms, member, kind))
    return sorted(trace, key=lambda event: event[0])


def check_roles(member, roles, quarantine_ms, slack_ms):
    """Yields broken rules: the order of roles, and the wait between claiming and active."""
    before, since = None, None
    for t_ms, role in roles:
        if role not in ALLOWED:
            yield f"{member}: unknown role {role} at {t_ms}"
            return
        if since is not None and t_ms < since:
            yield f"{member}: {role} at {t_ms} is logged after {before} at {since}"
        if role not in ALLOWED[before]:
            yield f"{member}: {role} at {t_ms} follows {before or 'nothing'}"
        if role == "active" and before == "claiming" and t_ms - since < quarantine_ms - slack_ms:
            yield f"{member}: active at {t_ms}, only {t_ms - since} ms after claiming"
        before, since = role, t_ms


def role_near(roles, t_ms, slack_ms):
    """Returns the roles that the member may have had at `t_ms`."""
    times = [at for at, _ in roles]
    first = bisect.bisect_right(times, t_ms - slack_ms) - 1
    last = bisect.bisect_right(times, t_ms + slack_ms)
    return {role for _, role in roles[max(first, 0):last]}


def check_wire(roles, trace, quarantine_ms, slack_ms):
    """Yields broken rules: requests outside of active, exchanges that overlap, and the gap at a handover."""
    open_request = {"a": None, "b": None}
    last_request = None  # (t_ms, member)
    for t_ms, member, kind in trace:
        other = "b" if member == "a" else "a"
        if kind == "answer":
            open_request[member] = None
            if last_request is not None and last_request[1] == other:
                yield f"{member}: answer at {t_ms:.0f}, after a request of {other} at {last_request[0]:.0f}"
            continue
        # The last exchange may end in time after the role has changed, but it does not begin then.
        if "active" not in role_near(roles[member], t_ms, slack_ms):
            yield f"{member}: request at {t_ms:.0f} while not active"
        if last_request is not None and last_request[1] == other:
            gap = t_ms - last_request[0]
            if gap < quarantine_ms / 2:
                yield f"{member}: request at {t_ms:.0f}, only {gap:.0f} ms after the last request of {other}"
            # A request without an answer for Q/2 has ended: the PLC was silent.
            began = open_request[other]
            if began is not None and t_ms - began < quarantine_ms / 2:
                yield f"{member}: request at {t_ms:.0f} during the exchange of {other} that began at {began:.0f}"
        open_request[member] = t_ms
        last_request = (t_ms, member)


def check(roles, trace, quarantine_ms, slack_ms):
    """Returns all broken rules. `roles`: {"a": [(t_ms, role)], "b": …}; `trace`: as from read_wire()."""
    found = []
    for member in ("a", "b"):
        found += check_roles(member, roles[member], quarantine_ms, slack_ms)
    return found + list(check_wire(roles, trace, quarantine_ms, slack_ms))


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quarantine-ms", type=float, required=True, help="Q: the wait of a claimant")
    parser.add_argument("--slack-ms", type=float, default=100)
    parser.add_argument("--wire", help="JSON lines")
    parser.add_argument("log_a")
    parser.add_argument("log_b")
    options = parser.parse_args(arguments)
    roles, trace = {}, []
    try:
        for member, path in (("a", options.log_a), ("b", options.log_b)):
            name = path
            with open(path, encoding="utf-8", errors="replace") as log:
                roles[member] = read_roles(log)
        if options.wire:
            name = options.wire
            with open(options.wire, encoding="utf-8") as wire:
                trace = read_wire(wire)
    except (OSError, ValueError) as fault:
        print(f"replay: {name}: {fault}", file=sys.stderr)
        return 2
    found = check(roles, trace, options.quarantine_ms, options.slack_ms)
    for line in found:
        print(line)
    changes = sum(len(each) for each in roles.values())
    print(f"{changes} roles, {len(trace)} events of the wire, {len(found)} broken rules")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
