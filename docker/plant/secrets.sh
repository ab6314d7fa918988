#!/bin/sh
# Makes the passwords of the plant to try, random ones, where they are not there yet:
#   docker/plant/secrets.sh
# A file that a container is to read has to be readable by its user; the directory keeps the others
# of this machine out.
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
