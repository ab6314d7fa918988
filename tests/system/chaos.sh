#!/bin/bash
# Injects all faults at once for a while, from a seed:
#   tests/system/chaos.sh --minutes 10 --seed 7 [--sync always|offline] [--version 5|3.1.1]
#   tests/system/chaos.sh --kills 200 --seed 7
# Prints a report; exit status 0 only if every check passes. Otherwise its directory is kept, with the plan, the
# agent's log and a trace of all observations. BUILD_DIR: the build directory of fxagent and fxsim, `build` in the
# project by default. As root it runs in its own mount namespace, which ends with it.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
build=${BUILD_DIR:-$here/../../build}
export FXAGENT=${FXAGENT:-$build/agent/fxagent} FXSIM=${FXSIM:-$build/tests/sim/fxsim}
export CLOCK_LIBRARY=${CLOCK_LIBRARY:-$build/tests/system/libshifted_clock.so}
alone=()
if unshare --mount true 2>/dev/null; then alone=(unshare --mount); fi
exec "${alone[@]}" /usr/bin/python3 -B "$here/chaos.py" "$@"
