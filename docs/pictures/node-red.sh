#!/bin/bash
# Takes the pictures of the flow of config/node-red, docs/pictures/node-red-*.png, with Node-RED and Chromium:
#   docs/pictures/node-red.sh [PORT]
# Start config/demo/run.sh first; PORT is its broker's, 1883 by default. Node-RED comes from npm and runs in a directory of
# its own, which the script removes at the end.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(cd "$here/../.." && pwd)
broker=${1:-1883}
work=$(mktemp -d)
node_red=
trap '[ -z "$node_red" ] || kill "$node_red"; rm -rf "$work"' EXIT
"$root/tests/npm.sh" "$root/tests/system/peers/node-red" "$work"
"$root/tests/npm.sh" "$root/tests/system/peers/browser" "$work/browser"

port=$(python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
sed "s/\"port\": \"1883\"/\"port\": \"$broker\"/" "$root/config/node-red/flows.json" >"$work/flows.json"
cat >"$work/settings.js" <<EOF
module.exports = { uiHost: "127.0.0.1", uiPort: $port, flowFile: "flows.json", credentialSecret: false,
  telemetry: { enabled: false }, editorTheme: { tours: false, palette: { editable: false } } };
EOF
node "$work/node_modules/node-red/red.js" -u "$work" >"$work/log" 2>&1 &
node_red=$!
until grep -q 'Connected to broker' "$work/log"; do
  kill -0 "$node_red" || { cat "$work/log" >&2; exit 1; }
  sleep 0.2
done

node "$root/tests/system/peers/browser/browser.js" "$work/browser" <<EOF >"$work/answers"
{"open": "http://127.0.0.1:$port/dashboard/fxagent", "width": 1100, "height": 760}
{"until": "(document.body.innerText.match(/good/g) ?? []).length > 5"}
{"fill": "input[inputmode=decimal]", "text": "65"}
{"press": "Enter"}
{"until": "document.body.innerText.includes('set-point 65: ')"}
{"until": "performance.now() > 25000"}
{"click": "text=Close"}
{"shot": "$here/node-red-dashboard.png"}
{"open": "http://127.0.0.1:$port/", "width": 1500, "height": 620}
{"until": "document.querySelectorAll('.red-ui-flow-node').length > 8"}
{"shot": "$here/node-red-flow.png"}
EOF
if grep '"error"' "$work/answers" >&2; then exit 1; fi
