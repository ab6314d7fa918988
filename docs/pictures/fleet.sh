#!/bin/bash
# Takes docs/pictures/fleet.png: `fxagent fleet` with three agents and a mosquitto of its own, as a terminal shows it.
#   docs/pictures/fleet.sh [FXAGENT]
# FXAGENT: the program, build/agent/fxagent by default. Needs mosquitto, python3 and chromium. It starts its programs in a
# directory of its own, and ends them.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
fxagent=$(realpath "${1:-$here/../../build/agent/fxagent}")
work=$(mktemp -d)
pids=()
trap '[ ${#pids[@]} -eq 0 ] || kill "${pids[@]}" 2>/dev/null || true; wait; rm -rf "$work"' EXIT
cd "$work"
port=$(python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
printf 'listener %s 127.0.0.1\nallow_anonymous true\n' "$port" >broker.conf
PATH=$PATH:/usr/sbin mosquitto -c broker.conf >broker.log 2>&1 &
pids+=($!)
fleet=(--broker "mqtt://127.0.0.1:$port" --root fx/plant-a)
for name in edge1 edge2 edge3; do
  line=line1
  if [ $name = edge2 ]; then line=line2; fi
  mkdir $name
  cat >$name.json <<JSON
{"agent": {"id": "$name", "root": "fx/plant-a", "remote_config": true}, "mqtt": {"servers": ["mqtt://127.0.0.1:$port"]},
 "store": {"path": "$work/$name"}, "links": [{"name": "$line", "tcp": {"host": "127.0.0.1", "port": 1}}], "devices": []}
JSON
  "$fxagent" run $name.json 2>/dev/null &
  pids+=($!)
done
cat >line2-v8.json <<'JSON'
{"version": "line2-v8", "by": "ann", "config": {"devices": [{"name": "meter", "link": "line1", "protocol": "modbus-tcp"}]}}
JSON
until "$fxagent" fleet status "${fleet[@]}" 2>/dev/null | grep -q '^3 of 3 online'; do sleep 0.2; done
# edge3 loses its power.
kill -KILL "${pids[3]}"
wait "${pids[3]}" 2>/dev/null || true
until grep -q '^2 of 3 online' <("$fxagent" fleet status "${fleet[@]}"); do sleep 0.2; done

show() {
  printf '<b>$ fxagent fleet %s --broker mqtt://broker --root fx/plant-a</b>\n' "$*"
  "$fxagent" fleet "$@" "${fleet[@]}" | sed 's/&/\&amp;/g; s/</\&lt;/g'
}
{
  echo '<!DOCTYPE html><meta charset="utf-8"><style>body { margin: 0; background: #1b1f24; }
    pre { margin: 20px; color: #d7dde4; font: 15px/1.45 "DejaVu Sans Mono", monospace; } b { color: #7fd1a0; }</style><pre>'
  show push line2-v8.json --agents edge1,edge2,edge3 || true
  echo
  show status || true
  echo '</pre>'
} >page.html
chromium --headless --no-sandbox --disable-gpu --hide-scrollbars --user-data-dir="$work/profile" \
  --window-size=1010,500 --screenshot="$here/fleet.png" "file://$work/page.html" 2>chromium.log || { cat chromium.log >&2; exit 1; }
