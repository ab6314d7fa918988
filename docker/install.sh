#!/bin/sh
# Installs the missing packages of some sections of packages.txt:
#   docker/install.sh build test
# Calls the package system only if something is missing, and needs root only then. Exit status: 0 everything is
# present, 1 a package could not be installed, 2 wrong usage.
set -eu

list=$(dirname "$0")/packages.txt

# Prints the packages of one section, one per line.
packages_of() {
  sed -n "s/^$1://p" "$list" | sed 's/([^)]*)//g' | tr -s ' ' '\n' | sed '/^$/d'
}

# A Node.js from elsewhere includes its own npm, which conflicts with Debian's.
is_installed() {
  if [ "$1" = npm ] && command -v npm >/dev/null; then return 0; fi
  [ "$(dpkg-query --show --showformat='${db:Status-Status}' "$1" 2>/dev/null)" = installed ]
}

[ $# -gt 0 ] || { echo "usage: $0 SECTION…" >&2; exit 2; }
wanted=
for section in "$@"; do
  packages=$(packages_of "$section")
  [ -n "$packages" ] || { echo "$0: no section '$section' in $list" >&2; exit 2; }
  wanted="$wanted $packages"
done

missing=
for package in $wanted; do
  is_installed "$package" || missing="$missing $package"
done
[ -n "$missing" ] || exit 0

if [ "$(id -u)" -ne 0 ]; then
  echo "$0: not installed, and only root can install:$missing" >&2
  echo "  sudo apt-get update && sudo apt-get install --no-install-recommends$missing" >&2
  exit 1
fi

echo "installing:$missing" >&2
log=$(mktemp)
trap 'rm -f "$log"' EXIT
export DEBIAN_FRONTEND=noninteractive
# shellcheck disable=SC2086 # a list of names
if ! { apt-get update && apt-get install --yes --no-install-recommends $missing; } >"$log" 2>&1; then
  echo "$0: apt-get failed; the end of its output:" >&2
  # The package source is local to this machine and does not belong in a log that is passed on.
  tail -n 20 "$log" |
    sed -E -e 's#[a-z+]+://[^ ]+#(source)#g' \
           -e "s#'?[A-Za-z0-9-]+(\.[A-Za-z0-9-]+)*\.[a-z]{2,}(:[0-9]+)?'?#(host)#g" >&2
  exit 1
fi
