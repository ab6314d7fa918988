#!/bin/sh
# Health check of the agent in this container, for the engine:
#   healthcheck.sh PID CONFIG
# Healthy: the process is an fxagent that is neither stopped nor dead, and its config file is still valid.
# An unreachable PLC, line or broker is not a fault of the agent; the state topics report those, and the health topic
# shows that the agent's loops are running.
# Exit status: 0 healthy, 1 not healthy; prints the reason in one line.
set -eu

process=/proc/$1
config=$2

unhealthy() {
  echo "unhealthy: $*"
  exit 1
}

[ -r "$process/comm" ] || unhealthy "no process $1"
[ "$(cat "$process/comm")" = fxagent ] || unhealthy "process $1 is not fxagent"
state=$(awk '/^State:/ { print $2 }' "$process/status")
case $state in
  R | S | D) ;;
  *) unhealthy "process $1 is in state $state" ;;
esac

fxagent check "$config" >/dev/null 2>&1 || unhealthy "$config has errors: fxagent check $config"
echo "healthy"
