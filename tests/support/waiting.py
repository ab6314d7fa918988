"""Waits of tests and benches for an event."""

import time

# The longest wait for an event on a busy machine; not a bound on anything measured.
PATIENCE = 30.0


def wait_for(what, condition, patience=PATIENCE):
    """Returns the first true value of condition(). Fails the test if there is none in time."""
    deadline = time.monotonic() + patience
    while True:
        value = condition()
        if value:
            return value
        if time.monotonic() > deadline:
            raise AssertionError("waited in vain for " + what)
        time.sleep(0.01)
