#!/bin/bash
# Fetches the packages of npm that a folder's lock file names, once:
#   tests/npm.sh FOLDER TARGET
# TARGET gets a copy of the folder with node_modules in it. Nothing is fetched where it is there for this
# very lock file. Where npm or its registry cannot be reached it says so and ends with 0: what needs the
# packages then says by name that it is skipped. For an hour after that it does not try again.
set -euo pipefail

folder=$1 target=$2
fetched=$target/fetched-lock.json missed=$target/missed-lock.json

# Says why, from what npm said.
skipped() {
  echo "tests: the packages of ${folder##*/tests/} could not be had from npm; what needs them is skipped:" >&2
  cat >&2
}

mkdir -p "$target"
if cmp -s "$folder/package-lock.json" "$fetched"; then
  cp "$folder"/* "$target"
  exit 0
fi
rm -rf "$target/node_modules" "$fetched"
cp "$folder"/* "$target"
if cmp -s "$folder/package-lock.json" "$missed" && [ -n "$(find "$missed" -mmin -60)" ]; then
  skipped <<<"not tried again, since it was tried within the last hour; to try: rm $missed"
  exit 0
fi
rm -f "$missed"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
# A registry that answers nothing at all costs each of these calls 20 s, twice.
if (cd "$target" && timeout 300 npm ci --no-audit --no-fund --loglevel=error --fetch-timeout=20000 --fetch-retries=1 \
  --fetch-retry-mintimeout=1000) >"$log" 2>&1; then
  cp "$folder/package-lock.json" "$fetched"
else
  rm -rf "$target/node_modules"
  cp "$folder/package-lock.json" "$missed"
  # Where packages come from is the business of this machine.
  tail -n 3 "$log" | sed -E 's#[a-z+]+://[^ ]+#(source)#g' | skipped
fi
