#!/bin/bash
# Everything goes wrong at once, for a while, by a seed:
#   tests/system/chaos.sh --minutes 10 --seed 7 [--sync always|offline] [--version 5|3.1.1]
#   tests/system/chaos.sh --kills 200 --seed 7
# Prints a report; exit status 0 only if every check holds. Otherwise its directory stays, with the plan,
# the agent's log and a trace of everything that was seen. BUILD_DIR: where fxagent and fxsim were built,
# `build` in the project unless set. As root in a mount namespace of its own, which ends with it.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
build=${BUILD_DIR:-$here/../../build}
export FXAGENT=${FXAGENT:-$build/agent/fxagent} FXSIM=${FXSIM:-$build/tests/sim/fxsim}
export CLOCK_LIBRARY=${CLOCK_LIBRARY:-$build/tests/system/libshifted_clock.so}
alone=()
if unshare --mount true 2>/dev/null; then alone=(unshare --mount); fi
exec "${alone[@]}" /usr/bin/python3 -B "$here/chaos.py" "$@"
