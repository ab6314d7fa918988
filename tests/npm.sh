#!/bin/bash
# Fetches the npm packages in a folder's lock file, once:
#   tests/npm.sh FOLDER TARGET
# TARGET gets a copy of the folder with node_modules in it. Nothing is fetched if TARGET already has the packages of
# this lock file. If npm or its registry is unreachable, the script prints that and exits with 0; the tests that need
# the packages then report by name that they are skipped. The script does not try again for an hour.
set -euo pipefail

folder=$1 target=$2
fetched=$target/fetched-lock.json missed=$target/missed-lock.json

# Prints the reason, from npm's output.
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
# With a registry that does not answer at all, each of these calls takes 20 s twice. On idle processor time beside a build, all
# of them can take many minutes.
if (cd "$target" && timeout 1200 npm ci --no-audit --no-fund --loglevel=error --fetch-timeout=20000 --fetch-retries=1 \
  --fetch-retry-mintimeout=1000) >"$log" 2>&1; then
  cp "$folder/package-lock.json" "$fetched"
else
  rm -rf "$target/node_modules"
  cp "$folder/package-lock.json" "$missed"
  # The package source is local to this machine.
  tail -n 3 "$log" | sed -E 's#[a-z+]+://[^ ]+#(source)#g' | skipped
fi
