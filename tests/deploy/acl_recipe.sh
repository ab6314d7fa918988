#!/bin/bash
# For a machine set up according to docs/operate/brokers-and-access.md, "Who may do what": starts its mosquitto and
# checks that each user can do exactly what is intended:
#   acl_recipe.sh PASSWORD
set -euo pipefail

password=$1
base=fx/plant-a/edge7
if (exec 3<>/dev/tcp/127.0.0.1/8883) 2>/dev/null; then
  echo "acl_recipe: port 8883 is taken by another broker"
  exit 1
fi
log=$(mktemp)
PATH=$PATH:/usr/sbin mosquitto -c /etc/mosquitto/mosquitto.conf >"$log" 2>&1 &
broker=$!
trap 'kill "$broker"; cat "$log" /var/log/mosquitto/mosquitto.log 2>/dev/null | tail -n 5 || true; rm -f "$log"' EXIT

as() {  # USER PROGRAM ARGUMENTS…
  local user=$1 program=$2
  shift 2
  "$program" -h localhost -p 8883 --cafile /etc/mosquitto/ca.pem -u "$user" -P "$password" -V 5 "$@"
}
for _ in $(seq 100); do
  if (exec 3<>/dev/tcp/127.0.0.1/8883) 2>/dev/null; then break; fi
  kill -0 "$broker"
  sleep 0.1
done

# Publishes as one user, retained, so that the time of reading does not matter; reads as another user.
passes() {  # WRITER READER TOPIC
  as "$1" mosquitto_pub -q 1 -r -t "$3" -m "from $1" >/dev/null 2>&1 || true
  [ "$(as "$2" mosquitto_sub -t "$3" -C 1 -W 3 2>/dev/null)" = "from $1" ]
}
expect() {  # yes|no WRITER READER TOPIC
  local got=no
  if passes "$2" "$3" "$4"; then got=yes; fi
  echo "acl_recipe: $2 writes, $3 reads $4: $got"
  [ "$got" = "$1" ]
}
expect yes edge7 display "$base/press1/data/fast"
expect yes edge7 anna "$base/press1/result"
expect yes anna edge7 "$base/press1/command"
expect no display edge7 "$base/press2/command"
expect no scada display "$base/press1/data/slow"
if as nobody mosquitto_pub -t x -m x 2>/dev/null; then echo "acl_recipe: a stranger was let in"; exit 1; fi
echo "acl_recipe: each user can do what is his and nothing else"
