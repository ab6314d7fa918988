#!/bin/sh
# Runs a script that asks for passwords on its terminal, and types the same password each time:
#   type_passwords.sh SCRIPT PASSWORD
set -eu

seen=$(mktemp)
trap 'rm -f "$seen"' EXIT
typist() {
  typed=0
  while [ ! -e "$seen.done" ]; do
    asked=$(grep -ac 'assword' "$seen" || true)
    if [ "$asked" -gt "$typed" ]; then
      # Input typed before the program has switched off the echo is discarded.
      sleep 0.3
      echo "$2"
      typed=$((typed + 1))
    fi
    sleep 0.05
  done
}
status=0
# mosquitto_passwd asks twice on one line: here each prompt becomes a separate line.
typist "$@" | { script -qefc "sh -ex $1" /dev/null; echo $? >"$seen.done"; } |
  stdbuf -o0 tr ':' '\n' >"$seen" || status=1
[ "$(cat "$seen.done")" = 0 ] || status=1
[ $status -eq 0 ] || cat "$seen"
rm -f "$seen.done"
exit $status
