#!/bin/bash
# Tests the installed fxagent of another processor under an emulator, in the root made by docker/cross.sh:
#   cross_trial.sh EMULATOR
set -euo pipefail

emulator=$1
fxagent() { "$emulator" /usr/bin/fxagent "$@"; }

dir=$(mktemp -d)
children=()
end() {
  for child in "${children[@]}"; do kill "$child" 2>/dev/null || true; done
  wait
  rm -rf "$dir"
}
trap end EXIT

fail() {
  echo "cross_trial: $*" >&2
  tail -n 5 "$dir"/*.log >&2
  exit 1
}
# Waits up to 20 s until a command succeeds.
await() {
  for _ in $(seq 200); do
    if "$@"; then return 0; fi
    sleep 0.1
  done
  return 1
}

fxagent --version
fxagent check /etc/fxagent/agent.json
fxagent check config/agent.example.json 2>/dev/null
fxagent decode modbus-rtu 11 03 00 6B 00 03 76 87
fxagent plan config/agent.example.json | head -n 3

port=18830
printf 'listener %s 127.0.0.1\nallow_anonymous true\npersistence false\n' $port >"$dir/broker.conf"
fxsim --plc "name=press1,model=FX3U,tcp=0,baud=9600,plant=demo" >"$dir/sim" 2>"$dir/sim.log" &
children+=($!)
await grep -q ready "$dir/sim" || fail "fxsim did not start"
sim_port=$(jq '.plcs[0].tcp' "$dir/sim")
jq --argjson port "$sim_port" --arg store "$dir/store" ".links[0].tcp = {host: \"127.0.0.1\", port: \$port} | .store.path = \$store
  | .mqtt = {servers: [\"mqtt://127.0.0.1:$port\"]}" docker/plant/agent.json >"$dir/agent.json"
fxagent check "$dir/agent.json"
fxagent read "$dir/agent.json" press1 D100
# Without a subshell, so that the child is the agent itself.
"$emulator" /usr/bin/fxagent run "$dir/agent.json" 2>"$dir/agent.log" &
agent=$!
children+=("$agent")
# Tested through a replaced libc function: the way it is called depends on the processor.
await grep -q 'broker_unreachable .*connection refused' "$dir/agent.log" || fail "a broker that is not there has no reason"
mosquitto -c "$dir/broker.conf" >"$dir/broker.log" 2>&1 &
children+=($!)
await mosquitto_pub -p $port -t ready -n 2>/dev/null || fail "there is no broker"
base=fx/plant-a/edge7
mosquitto_sub -p $port -t "$base/#" -F '%t %p' >"$dir/messages" 2>"$dir/sub.log" &
children+=($!)
await grep -q "^$base/press1/data/fast .*zone1" "$dir/messages" || fail "no telemetry came"
await grep -q "^$base/state .*online" "$dir/messages" || fail "the agent is not online"
mosquitto_pub -p $port -q 1 -t $base/press1/command -m '{"id":"cross-1","op":"write","tag":"setpoint","value":60}'
await grep -q "^$base/press1/result .*SUCCEEDED" "$dir/messages" || fail "no result came"
grep "^$base/press1/result" "$dir/messages"
kill "$agent"
wait "$agent" || fail "the agent did not end in order"
fxagent audit "$dir/agent.json"
fxagent audit "$dir/agent.json" --verify
