"""What devices did for the commands of a test, and the judge of whether a result agrees with that, as the contract's
table of statuses says.

A deed is the change of one place: (device, kind, place, value), with the kind of fxsim's log: write, force_on or
force_off. A test lets no two commands ask for the same deed, so the log tells what was done for which command.
"""

import collections

FORCED = {"force_on": 1, "force_off": 0}  # kind of command -> value of its bit


class Deeds:
    """The changes that the simulator's log reports, read on from where the last reading ended."""

    def __init__(self, sim, devices):
        self.sim = sim
        self.since = dict.fromkeys(devices, 0)
        self.count = collections.Counter()  # deed -> times
        self.values = collections.defaultdict(list)  # (device, place) -> [(time, value)]

    def collect(self):
        for device, since in self.since.items():
            for entry in self.sim.log(device, since):
                self.since[device] = entry["index"] + 1
                if entry["kind"] in ("write", *FORCED):
                    values = entry["value"] if isinstance(entry["value"], list) else [entry["value"]]
                    area = entry["device"].rstrip("0123456789")
                    first = int(entry["device"].removeprefix(area))
                    for number, value in enumerate(values, first):
                        self.add(device, entry["kind"], f"{area}{number}", value, entry["ms"] / 1000)
        return self

    def add(self, device, kind, place, value, at):
        self.count[device, kind, place, value] += 1
        self.values[device, place].append((at, value))

    def value(self, device, place, at):
        """Returns the value that a place of a device without a program had at that time."""
        return next((value for when, value in reversed(self.values[device, place]) if when < at), 0)


def without_times(result):
    """Returns the part of a result by which a repeated one is the same."""
    return {key: value for key, value in result.items() if key != "t"}


def untruth_of(result, done):
    """Returns what is not true of a result; None: it is true. `done`: how many of its places each target has set, and
    how many it has."""
    if "targets" not in result:
        return untruth_of_one(result, *done[0])
    status = result["status"]
    whole = sum(1 for n, of in done if n == of)
    if status in ("REJECTED", "EXPIRED", "FAILED") and result["reason"] != "verify_mismatch":
        return f"{status}, and it was done" if any(n for n, _ in done) else None
    if status == "SUCCEEDED" and whole < len(done):
        return "SUCCEEDED, and not all was done"
    if status == "PARTIAL" and (result["done"], result["of"]) != (whole, len(done)):
        return f"PARTIAL: really {whole} of {len(done)}"
    if status == "UNKNOWN_OUTCOME" and result.get("done", 0) > whole:
        return "UNKNOWN_OUTCOME with more done than was"
    found = (untruth_of_one(target, *one) for target, one in zip(result["targets"], done))
    return next((why for why in found if why), None)


def untruth_of_one(result, done, of=1):
    """The same for one target, or for a command of one target."""
    status = result["status"]
    if status == "SUCCEEDED" or result["reason"] == "verify_mismatch":
        return None if done == of else f"{status}, and not all was done"
    if status in ("REJECTED", "EXPIRED", "FAILED"):
        return f"{status}, and it was done" if done else None
    if status == "PARTIAL" and ((result["done"], result["of"]) != (done, of) or not 0 < done < of):
        return f"PARTIAL: really {done} of {of}"
    if status == "UNKNOWN_OUTCOME" and result.get("done", 0) > done:
        return "UNKNOWN_OUTCOME with more done than was"
    return None
