#!/bin/sh
# Creates random passwords for the trial plant, unless they exist:
#   docker/plant/secrets.sh
# A file for a container has to be readable by the container's user; the directory's mode keeps other users of this
# machine out.
set -eu

directory=$(dirname "$0")/secrets
umask 077
mkdir -p "$directory"
for user in edge7 operator; do
  file=$directory/$user
  [ -s "$file" ] || od -An -N16 -tx1 /dev/urandom | tr -d ' \n' >"$file"
  chmod 444 "$file"
done
echo "$directory/operator holds the password of the user operator"
