#!/bin/sh
# Creates the password file from the secrets, which are the plain passwords, and then runs the broker:
#   broker.sh CONFIG PASSWORDS
# SECRETS: the directory of the secrets, one file per user; /run/secrets by default.
set -eu

config=$1
passwords=$2
secrets=${SECRETS:-/run/secrets}

# Hashed in place, because other users can see a program's arguments.
umask 077
: >"$passwords"
for user in edge7 operator; do
  password=$(cat "$secrets/$user")
  [ -n "$password" ] || { echo "$0: $secrets/$user is empty" >&2; exit 1; }
  printf '%s:%s\n' "$user" "$password" >>"$passwords"
done
mosquitto_passwd -U "$passwords"
exec mosquitto -c "$config"
