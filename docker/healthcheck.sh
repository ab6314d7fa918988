#!/bin/sh
# Whether the agent of this container lives, for the engine:
#   healthcheck.sh PID CONFIG
# Right: the process is an fxagent that is neither stopped nor dead, and its config file is still right.
# A PLC, a line or a broker that is away is no fault of the agent; the state topics tell that, and the
# health topic shows that its loops turn.
# Exit status: 0 healthy, 1 not; one line says why.
set -eu

process=/proc/$1
config=$2

unhealthy() {
  echo "unhealthy: $*"
  exit 1
}

[ -r "$process/comm" ] || unhealthy "no process $1"
[ "$(cat "$process/comm")" = fxagent ] || unhealthy "process $1 is no fxagent"
state=$(awk '/^State:/ { print $2 }' "$process/status")
case $state in
  R | S | D) ;;
  *) unhealthy "process $1 is in state $state" ;;
esac

fxagent check "$config" >/dev/null 2>&1 || unhealthy "$config is not right: fxagent check $config"
echo "healthy"
