#!/bin/bash
# Fetches the packages of npm that a folder's lock file names, once:
#   tests/npm.sh FOLDER TARGET
# TARGET gets a copy of the folder with node_modules in it. Nothing is fetched where it is there for this
# very lock file. Where npm or its registry cannot be reached it says so and ends with 0: what needs the
# packages then says by name that it is skipped.
set -euo pipefail

folder=$1 target=$2
mkdir -p "$target"
if cmp -s "$folder/package-lock.json" "$target/fetched-lock.json"; then
  cp "$folder"/* "$target"
  exit 0
fi
rm -rf "$target/node_modules" "$target/fetched-lock.json"
cp "$folder"/* "$target"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
if (cd "$target" && timeout 300 npm ci --no-audit --no-fund --loglevel=error) >"$log" 2>&1; then
  cp "$folder/package-lock.json" "$target/fetched-lock.json"
else
  rm -rf "$target/node_modules"
  echo "tests: the packages of ${folder##*/tests/} could not be had from npm; what needs them is skipped:" >&2
  # Where packages come from is the business of this machine.
  tail -n 3 "$log" | sed -E 's#[a-z+]+://[^ ]+#(source)#g' >&2
fi
