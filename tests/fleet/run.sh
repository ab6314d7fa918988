#!/bin/sh
# Plays 1,000, 5,000 and 10,000 agents against a mosquitto of its own, kills it with SIGKILL, and prints a table.
# Takes about two minutes for each number on an idle machine. For the options see README.md.
set -eu
usage="usage: run.sh [--agents '1000 5000 10000'] [--interval-ms N] [--down S] [--json DIRECTORY] [-- OPTION OF fxfleet ...]"
agents="1000 5000 10000"
interval=10000
down=5
keep=
while [ $# -gt 0 ]; do
  case $1 in
    --agents) agents=$2; shift 2 ;;
    --interval-ms) interval=$2; shift 2 ;;
    --down) down=$2; shift 2 ;;
    --json) keep=$2; shift 2 ;;
    --) shift; break ;;
    *) echo "$usage" >&2; exit 2 ;;
  esac
done
here=$(cd "$(dirname "$0")" && pwd)
build=${BUILD_DIR:-$here/../../build}
fxfleet=${FXFLEET:-$build/tests/fleet/fxfleet}
mosquitto=$(PATH=$PATH:/usr/sbin command -v mosquitto)
[ -x "$fxfleet" ] || { echo "run.sh: $fxfleet is missing: ninja -C $build fxfleet" >&2; exit 2; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
out=${keep:-$work}
mkdir -p "$out"
port=$(/usr/bin/python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
cat > "$work/mosquitto.conf" <<END
listener $port 127.0.0.1
allow_anonymous true
log_dest stderr
log_type error
log_type warning
set_tcp_nodelay true
max_inflight_messages 20
max_queued_messages 1000
END

for count in $agents; do
  "$fxfleet" --agents "$count" --interval-ms "$interval" --broker "127.0.0.1:$port" --start "$mosquitto -c $work/mosquitto.conf" \
    --broker-log "$work/mosquitto.log" --seconds 25 --storm-at 15 --down "$down" "$@" > "$out/$count.json" ||
    { echo "run.sh: not complete with $count agents:"; cat "$out/$count.json"; tail -n 5 "$work/mosquitto.log"; exit 1; } >&2
done
echo "$(nproc) cores, load $(cut -d' ' -f1 /proc/loadavg); a sample of each agent every $interval ms; broker down for $down s"
for count in $agents; do cat "$out/$count.json"; done | jq -rs '
  def row($name; f): "| " + $name + " | " + (map(f | tostring) | join(" | ")) + " |";
  row("agents"; .agents),
  "|---" * (length + 1) + "|",
  row("first connect: all, s"; .connect.all_s),
  row("first connect: a second"; .connect.connects_per_s),
  row("first connect: CPU of the broker, ms each"; .connect.broker_cpu_ms_per_connect),
  row("steady: messages to the broker a second"; .steady.published_per_s),
  row("steady: acknowledgement p50, ms"; .steady.acknowledgement.p50_ms),
  row("steady: acknowledgement p99, ms"; .steady.acknowledgement.p99_ms),
  row("steady: CPU of the broker, %"; .steady.broker_cpu_percent),
  row("steady: CPU of the broker, µs a message"; .steady.broker_cpu_us_per_message),
  row("steady: CPU of fxfleet, %"; .steady.own_cpu_percent),
  row("memory of the broker, KiB a session"; .steady.broker_rss_kib_per_session),
  row("storm: 50 % back, s after the restart"; .storm.back_50_percent_s),
  row("storm: 99 % back, s"; .storm.back_99_percent_s),
  row("storm: all back, s"; .storm.back_all_s),
  row("storm: all samples of the outage acknowledged, s"; .storm.caught_up_s),
  row("storm: most connects in one second"; .storm.most_connects_in_a_second),
  row("storm: attempts that failed"; .storm.failed_attempts),
  row("storm: CPU of the broker, ms a connect"; .storm.broker_cpu_ms_per_connect),
  row("commands: sent"; .totals.commands_sent),
  row("commands: with one result"; .totals.commands_answered),
  row("commands: second results"; .totals.second_results),
  row("samples: made"; .totals.samples_made),
  row("samples: acknowledged"; .totals.samples_acknowledged)'
