#!/bin/bash
# Speed, beside the bridges that users write by hand (Python: pymodbus and paho-mqtt; Node.js:
# modbus-serial and mqtt.js), and size and store by themselves, in one run on one machine:
#   tests/bench/run.sh [--only a,b,c,d,e,f,g,h,i] [--seconds N] [--samples N] [--json FILE]
# (a) to (d) speed, (e) and (f) many devices, (g) many links, (h) many tags, (i) the store.
# Installs what is missing, builds in Release, prints a table. BUILD_DIR: where (build-bench).
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
cd "$root"
build=${BUILD_DIR:-$root/build-bench}

docker/install.sh build test
cmake -G Ninja -S . -B "$build" -DCMAKE_BUILD_TYPE=Release >/dev/null
ninja -C "$build" fxagent fxsim >/dev/null

node=$build/bench-node
mkdir -p "$node"
cp tests/bench/node/* "$node"
(cd "$node" && npm ci --no-audit --no-fund --loglevel=error >/dev/null)

FXAGENT=$build/agent/fxagent FXSIM=$build/tests/sim/fxsim NODE_BRIDGE=$node \
  PYTHONDONTWRITEBYTECODE=1 /usr/bin/python3 tests/bench/bench.py "$@"
