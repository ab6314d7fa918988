#!/bin/bash
# Takes the pictures of config/node-red, docs/pictures/node-red-*.png, with Node-RED and Chromium:
#   docs/pictures/node-red.sh [PORT]
# Start config/demo/run.sh first; PORT is its broker's, 1883 by default. Node-RED runs in a directory of its own, which
# the script removes at the end. Its packages and those of the browser come from npm, or from the folders NODE_RED and
# BROWSER_MODULES, as in tests/system.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(cd "$here/../.." && pwd)
broker=${1:-1883}
work=$(mktemp -d)
node_red=
trap '[ -z "$node_red" ] || kill "$node_red"; rm -rf "$work"' EXIT
if [ -z "${NODE_RED:-}" ]; then
  NODE_RED=$work/node-red
  "$root/tests/npm.sh" "$root/tests/system/peers/node-red" "$NODE_RED"
fi
if [ -z "${BROWSER_MODULES:-}" ]; then
  BROWSER_MODULES=$work/browser
  "$root/tests/npm.sh" "$root/tests/system/peers/browser" "$BROWSER_MODULES"
fi

mkdir -p "$work/user/node_modules"
ln -s "$NODE_RED"/node_modules/* "$root/config/node-red/contrib" "$work/user/node_modules/"
mv "$work/user/node_modules/contrib" "$work/user/node_modules/node-red-contrib-fxagent"
port=$(python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
sed "s/\"port\": \"1883\"/\"port\": \"$broker\"/" "$root/config/node-red/flows.json" >"$work/user/flows.json"
cat >"$work/user/settings.js" <<EOF
module.exports = { uiHost: "127.0.0.1", uiPort: $port, flowFile: "flows.json", credentialSecret: false,
  telemetry: { enabled: false }, editorTheme: { tours: false, palette: { editable: false } } };
EOF
node "$NODE_RED/node_modules/node-red/red.js" -u "$work/user" >"$work/log" 2>&1 &
node_red=$!
until grep -q 'Connected to broker' "$work/log"; do
  kill -0 "$node_red" || { cat "$work/log" >&2; exit 1; }
  sleep 0.2
done

# Obeys the commands of browser.js on standard input.
browse() {
  node "$root/tests/system/peers/browser/browser.js" "$BROWSER_MODULES" >"$work/answers"
  if grep '"error"' "$work/answers" >&2; then exit 1; fi
}

browse <<EOF
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

# The examples of the nodes.
jq -s add "$root"/config/node-red/contrib/examples/*.json | sed "s/\"port\": \"1883\"/\"port\": \"$broker\"/" |
  node -e 'const headers = {"Content-Type": "application/json"};
           fetch(process.argv[1], {method: "POST", headers, body: fs.readFileSync(0)})
             .then((answer) => process.exit(answer.ok ? 0 : 1))' "http://127.0.0.1:$port/flows"
browse <<EOF
{"open": "http://127.0.0.1:$port/", "width": 1500, "height": 620}
{"until": "document.querySelectorAll('.red-ui-flow-node').length > 4"}
{"until": "(RED.workspaces.show('fxnodesatab0001'), true)"}
{"until": "/zone1[0-9]/.test(document.querySelector('#red-ui-workspace-chart').textContent)"}
{"shot": "$here/node-red-values.png"}
{"until": "(RED.workspaces.show('fxnodesbtab0001'), RED.menu.toggleSelected('menu-item-sidebar', false), true)"}
{"until": "(fetch('inject/fxnodesbinject1', {method: 'POST'}), true)"}
{"until": "document.querySelector('#red-ui-workspace-chart').textContent.includes('SUCCEEDED')"}
{"until": "(fetch('inject/fxnodesbinject2', {method: 'POST'}), true)"}
{"until": "document.querySelector('#red-ui-workspace-chart').textContent.includes('setpoint 160')"}
{"until": "(RED.editor.edit(RED.nodes.node('fxnodesbcommand')), true)"}
{"until": "document.querySelector('#node-input-tag') !== null"}
{"click": "#node-input-tag"}
{"until": "document.querySelector('.red-ui-autoComplete-container') !== null"}
{"shot": "$here/node-red-command.png"}
EOF
