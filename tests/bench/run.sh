#!/bin/bash
# Measures speed next to hand-written bridges (Python: pymodbus and paho-mqtt; Node.js: modbus-serial and mqtt.js),
# and size and store alone, in one run on one machine:
#   tests/bench/run.sh [--only a,b,c,d,e,f,g,h,i,j,k] [--seconds N] [--samples N] [--json FILE] [--share F] [--smoke]
# (a) to (d) speed, (e) and (f) many devices, (g) many links, (h) many tags, (i) the store, (j) commands after a
# silence, (k) the start. --smoke: each part once, small and short; verifies the bench and measures nothing.
# Installs missing packages, builds, prints a table. BUILD_DIR: the build directory (build-bench).
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
cd "$root"
build=${BUILD_DIR:-$root/build-bench}

docker/install.sh build test
cmake -G Ninja -S . -B "$build" -DFXAGENT_TESTS=OFF -DFXAGENT_SIM=ON >/dev/null
ninja --quiet -C "$build" fxagent fxsim

peers=$build/npm/peers
tests/npm.sh tests/system/peers/node "$peers"

FXAGENT=$build/agent/fxagent FXSIM=$build/tests/sim/fxsim NODE_PEERS=$peers \
  PYTHONDONTWRITEBYTECODE=1 /usr/bin/python3 tests/bench/bench.py "$@"
