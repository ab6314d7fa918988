#!/bin/bash
# The complete system on this machine, without hardware:
#   config/demo/run.sh [--seconds N]
# Installs missing packages (only then as root), builds the agent and the simulator, and starts
#   mosquitto  a broker on port 1883 of the loopback, or on another free port, with its own configuration,
#   fxsim      two FX3U with an oven and a conveyor and a Modbus meter, on pseudo terminals paced at 9600 baud,
#   fxagent    with agent.json of this directory, and its page for a browser.
# Prints the agent's messages as they arrive, one per line. After some seconds it sends three commands to the PLC
# (stop the conveyor, start it, a new setpoint) and prints their results.
#
# Without --seconds it runs until Ctrl-C. With it, it stops N seconds after everything has started. It then exits with
# 0 only if it received live telemetry with values and the PLC acknowledged a command, otherwise with 1. BUILD_DIR:
# the build directory, `build` in the project by default.
# Leaves nothing behind except the build directory.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(cd "$here/../.." && pwd)
build=${BUILD_DIR:-$root/build}
base=fx/plant-a/edge7
press=$base/press1

usage() {
  echo "usage: $0 [--seconds N]" >&2
  exit 2
}

seconds=
while [ $# -gt 0 ]; do
  case $1 in
    --seconds) seconds=${2:-}; [[ $seconds =~ ^[1-9][0-9]{0,6}$ ]] || usage; shift 2 ;;
    -h | --help) sed -n '2,/^set /{/^#/s/^# \{0,1\}//p}' "${BASH_SOURCE[0]}"; exit 0 ;;
    *) usage ;;
  esac
done

# One line per step, with the seconds since the start, so that nothing looks stuck.
say() { printf '[%3d s] %s\n' "$SECONDS" "$*"; }

say "installing missing packages (docker/packages.txt: build, demo)"
"$root/docker/install.sh" build demo

# An existing build directory keeps its options, and gets the simulator if it has none.
configure() {
  local options=(-DFXAGENT_SIM=ON)
  [ -f "$build/CMakeCache.txt" ] || options+=(-G Ninja -DFXAGENT_TESTS=OFF)
  cmake -S "$root" -B "$build" "${options[@]}"
}
# Prints every tenth step of ninja's `[n/m]` and writes the full output to a file.
compile() {
  NINJA_STATUS='[%f/%t] ' cmake --build "$build" --target fxagent fxsim 2>&1 | tee "$1" |
    while read -r line; do
      [[ $line =~ ^\[([0-9]+)/([0-9]+)\] ]] || continue
      n=${BASH_REMATCH[1]} of=${BASH_REMATCH[2]}
      if ((n % 10 == 0 || n == of)); then say "compiling $n of $of"; fi
    done
}
log=$(mktemp)
trap 'rm -f "$log"' EXIT
say "configuring in $build"
configure >"$log" 2>&1 || { cat "$log"; echo "demo: the configure failed"; exit 1; } >&2
say "compiling fxagent and fxsim: minutes the first time, seconds later"
compile "$log" || { cat "$log"; echo "demo: the build failed"; exit 1; } >&2
rm -f "$log"
agent=$build/agent/fxagent
sim=$build/tests/sim/fxsim
# Debian installs the broker in /usr/sbin, which is only in root's PATH.
broker=$(PATH=$PATH:/usr/sbin command -v mosquitto)

dir=$(mktemp -d)
meter_pid='' agent_pid='' viewer_pid='' printer_pid='' sim_pid='' broker_pid=''

# Ends a child by its id and waits for it; kills it after 10 s.
stop() {
  [ -n "$1" ] || return 0
  kill -TERM "$1" 2>/dev/null || true
  for _ in $(seq 100); do
    kill -0 "$1" 2>/dev/null || break
    sleep 0.1
  done
  kill -KILL "$1" 2>/dev/null || true
  wait "$1" 2>/dev/null || true
}

clean_up() {
  trap '' INT TERM
  # The agent first, so that its last messages still reach the broker and the viewer.
  for pid in $agent_pid $viewer_pid $sim_pid $meter_pid $broker_pid; do stop "$pid"; done
  [ -z "$printer_pid" ] || wait "$printer_pid" 2>/dev/null || true
  rm -rf "$dir"
}
trap clean_up EXIT
# Ctrl-C is the normal end of a run without a limit.
trap '[ -z "$seconds" ]; exit' INT TERM

# Prints the error and the end of every log, and exits.
give_up() {
  echo "demo: $*" >&2
  for file in "$dir"/*.log; do
    [ -s "$file" ] || continue
    echo "--- the end of $(basename "$file")" >&2
    tail -n 15 "$file" >&2
  done
  exit 1
}

# Waits up to 10 s until a command succeeds.
await() {
  for _ in $(seq 100); do
    "$@" && return 0
    sleep 0.1
  done
  return 1
}

is_open() { (exec 3<>"/dev/tcp/127.0.0.1/$1") 2>/dev/null; }

# 1883 first, because clients expect a broker there, such as the flow in config/node-red.
# Another process may take a free port before the broker binds it: the broker then exits, and the script tries the
# next port.
start_broker() {
  for try in $(seq 20); do
    port=$((20000 + RANDOM % 20000))
    [ "$try" -gt 1 ] || port=1883
    is_open "$port" && continue
    printf 'listener %s 127.0.0.1\nallow_anonymous true\npersistence false\n' "$port" >"$dir/broker.conf"
    "$broker" -c "$dir/broker.conf" >"$dir/broker.log" 2>&1 &
    broker_pid=$!
    for _ in $(seq 50); do
      kill -0 "$broker_pid" 2>/dev/null || break
      is_open "$port" && return 0
      sleep 0.1
    done
    stop "$broker_pid"
  done
  give_up "no broker could be started"
}

# One line per message: time, topic below the agent's, and the shortened payload.
# shellcheck disable=SC2016 # jq's own variables
readable='
  def name: sub("^'$base'/"; "");
  def shown: to_entries | map("\(.key)=\(.value)") | join(" ");
  (.topic | name) as $topic
  | (.payload | fromjson? // null) as $p
  | select($p != null)
  | (if ($topic | contains("/data/")) then
       "#\($p.seq) " + ($p.values // {} | shown)
       + (if $p.bad then "  bad: " + ($p.bad | map_values(.why) | shown) else "" end)
     elif ($topic | endswith("/result")) then
       "\($p.id): \($p.status) plc=\($p.plc) \($p.detail // "")" + " total_ms=\($p.t.total_ms)"
     elif ($topic | endswith("/command")) then "\($p)"
     elif ($topic | endswith("/meta")) then "\($p.tags | length) tags"
     elif $topic == "health" then "samples: " + ($p.samples | shown)
     else "\($p)" end) as $text
  | "\(now | strflocaltime("%H:%M:%S"))  \($topic)  \($text)"'

# The last line may be incomplete: lines that are not JSON are skipped.
seen() {
  jq -e -n -R "[inputs | fromjson? | .payload = ((.payload | fromjson?) // {})] | any(.[]; $1)" \
    "$dir/messages" >"$dir/seen"
}
saw_telemetry() {
  seen '(.topic | startswith("'$press'/data/")) and (.topic | endswith("/history") | not)
        and (.payload.values // {} | length > 0)'
}
saw_ack() {
  seen '.topic == "'$press'/result" and .payload.status == "SUCCEEDED" and .payload.plc == "ACK"'
}

order() {
  echo "--------- command: $1"
  mosquitto_pub -p "$port" -q 1 -t "$press/command" -m "$1" || give_up "the command was not published"
}

say "starting a broker, a simulated PLC and the agent"
start_broker
"$sim" --plc "name=press1,model=FX3U,pty=$dir/press1,baud=9600,plant=demo" \
  --plc "name=press2,protocol=fx-computer-link,model=FX3U,pty=$dir/press2,baud=9600,plant=demo" >"$dir/sim.ready" 2>"$dir/sim.log" &
sim_pid=$!
# The meter has a simulator of its own, so that its cable can be pulled.
start_meter() {
  "$sim" --plc "name=meter,protocol=modbus-rtu,pty=$dir/meter,baud=9600,plant=counter" >"$dir/meter.ready" 2>"$dir/meter.log" &
  meter_pid=$!
  await grep -q '"ready":true' "$dir/meter.ready" || give_up "the simulator of the meter did not start"
}
start_meter
await grep -q '"ready":true' "$dir/sim.ready" || give_up "the simulator did not start"

: >"$dir/messages"  # must exist before either of the two opens it
mosquitto_sub -p "$port" -q 1 -F %j -t "$base/#" >>"$dir/messages" 2>"$dir/viewer.log" &
viewer_pid=$!
# Ends on its own when the viewer has ended.
tail -n +1 -f --pid="$viewer_pid" "$dir/messages" | jq --unbuffered -r "$readable" &
printer_pid=$!

mkdir "$dir/store"
# A token for commands from the page.
token=$(od -An -N8 -tx1 /dev/urandom | tr -d ' \n')
(umask 077 && echo "demo $token" >"$dir/token")
# The page: on port 8080 if that is free, otherwise on any free port (0).
http=8080
! is_open "$http" || http=0
DEMO_PORT=$port DEMO_DIR=$dir DEMO_HTTP=$http \
  "$agent" run "$here/agent.json" >"$dir/agent.out" 2>"$dir/agent.log" &
agent_pid=$!
start=$SECONDS

await grep -q 'metrics state=listening' "$dir/agent.log" || give_up "the page did not start"
page=http://$(sed -n 's/.*metrics state=listening listen=//p' "$dir/agent.log" | head -n 1)/
echo "broker on 127.0.0.1:$port, PLC on $dir/press1, base topic $base"
echo "the page: $page (commands from it need the token $token)"
[ -n "$seconds" ] || echo "Ctrl-C ends it"

# Sleeps until the given second after the start, or to the end; fails when a part has died.
until_second() {
  while [ $((SECONDS - start)) -lt "$1" ]; do
    [ -z "$seconds" ] || [ $((SECONDS - start)) -lt "$seconds" ] || return 0
    kill -0 "$agent_pid" 2>/dev/null || give_up "the agent ended unexpectedly"
    kill -0 "$sim_pid" 2>/dev/null || give_up "the simulator ended unexpectedly"
    kill -0 "$broker_pid" 2>/dev/null || give_up "the broker ended unexpectedly"
    sleep 0.2
  done
}

for _ in $(seq 20); do
  saw_telemetry && break
  until_second $((SECONDS - start + 1))
done
saw_telemetry || give_up "no telemetry within 20 s"
say "the first live values are here"

# A short demo sends its commands early, because the results need time too.
first=4
[ -z "$seconds" ] || [ "$seconds" -ge 8 ] || first=$((seconds / 3))
until_second "$first"
order '{"id":"demo-1","op":"force_on","address":"M101","by":"demo"}'
until_second $((first + 3))
order '{"id":"demo-2","op":"force_on","address":"M100","by":"demo"}'
order '{"id":"demo-3","op":"write","tag":"setpoint","value":60,"by":"demo"}'

if [ -z "$seconds" ]; then
  until_second $((first + 6))
  cat <<END
--------- open $page in a browser, or try in another terminal:
  mosquitto_sub -p $port -v -t '$base/#'
  mosquitto_pub -p $port -q 1 -t $press/command -m '{"id":"mine-1","op":"write","tag":"setpoint","value":70}'
(every command needs its own id: a used id gets the result DUPLICATE)
or import config/node-red/flows.json into Node-RED: values, a trend, alarms and a set-point
END
  while true; do
    until_second $((SECONDS - start + 100))
    echo "--------- the cable of the meter is pulled for 20 s"
    stop "$meter_pid"
    until_second $((SECONDS - start + 20))
    start_meter
  done
fi
until_second "$seconds"

missing=
saw_telemetry || missing="live telemetry with values"
saw_ack || missing="${missing:+$missing, and }a result with status SUCCEEDED and plc ACK"
[ -z "$missing" ] || give_up "within $seconds s there was no $missing"
say "live telemetry and an acknowledged command were seen"
cat <<END
next:
  $0
      the same until Ctrl-C, with commands to try
  $agent plan $root/config/agent.example.json
      the load of a line, and how long a command takes
  README.md, Install
      put it on a machine with a PLC
END
