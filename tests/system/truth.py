"""Judges whether a result agrees with what the device did, as the contract's table of statuses says."""


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
