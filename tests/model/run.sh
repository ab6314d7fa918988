#!/bin/bash
# Checks the models of the standby pair with spin: the right model has no error, and each mutation has one.
#   tests/model/run.sh            the bounds for CI
#   tests/model/run.sh --large    also larger bounds of the right model, a minute or two
# Prints one line per check: expected and found, states, depth, seconds. Exit status: 0 all as expected, 1 not.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
failed=0 count=0
memory=2000  # MB

# check MODEL holds|fails MACRO…: `fails` means that spin must find a violated assertion.
check() {
  local model=$1 expected=$2 name="" macros=() macro found report
  shift 2
  for macro in "$@"; do macros+=("-D$macro") name+=" $macro"; done
  count=$((count + 1))
  (cd "$work" && rm -f pan* ./*.trail && spin -a "${macros[@]}" "$here/$model.pml" >spin.log 2>&1 &&
    "${CC:-gcc}" "$([ "$expected" = holds ] && echo -O2 || echo -O0)" -w -DSAFETY -DCOLLAPSE -DMEMLIM=$memory -o pan pan.c) ||
    { cat "$work/spin.log"; echo "$model$name: no model to check"; failed=$((failed + 1)); return; }
  report=$(cd "$work" && ./pan -m3000000 -w20 -n 2>&1) || true
  # A search that was cut short proves nothing.
  if grep -q 'assertion violated' <<<"$report"; then
    found=fails
  elif grep -q 'errors: 0$' <<<"$report" && ! grep -qE 'max search depth too small|not completed|out of memory' <<<"$report"; then
    found=holds
  else
    found=unknown
  fi
  printf '%-7s %-48s %-16s %8s states, depth %6s, %s s\n' "$found" "$model$name" \
    "$([ "$found" = "$expected" ] || echo "NOT $expected")" \
    "$(sed -nE 's/^ *([0-9.e+]+) states, stored.*/\1/p' <<<"$report")" \
    "$(sed -nE 's/.*depth reached ([0-9]+).*/\1/p' <<<"$report")" \
    "$(sed -nE 's/^pan: elapsed time ([0-9.e+-]+) seconds/\1/p' <<<"$report")"
  if [ "$found" != "$expected" ]; then
    failed=$((failed + 1))
    [ "$found" = fails ] || echo "$report"
  fi
}

# The right models, and the bounds of their assumptions.
check lease holds Q=6
check lease holds Q=4
check lease holds Q=4 L=2               # L = Q/2
check lease fails Q=4 L=3               # L > Q/2
check lease holds Q=4 L=1 SPLIT_CHECK PAUSE_MAX=1
check lease fails Q=4 L=2 SPLIT_CHECK PAUSE_MAX=1
check lease fails Q=4 SPLIT_CHECK
check journal holds NC=1
check journal holds NC=1 SENDS=0 SEQ
check journal holds NC=1 FAULTS=1 FORGET BLIND_RULE
check journal holds NC=1 FAULTS=1 EPHEMERAL BLIND_RULE
check journal holds NC=1 FAULTS=1 LOSE BLIND_RULE MERGE ONLY_RUNS

# The models are not empty: the wire goes from one to the other and back, and everything comes to rest.
check lease fails Q=4 REACH
check journal fails NC=1 REACH

# The mutations.
for mutation in NO_WAIT NO_LEASE_CHECK LEASE_FROM_ACK STAMP_AFTER_SEND WAIT_FROM_CONNECT RECONNECT_WITHOUT_WAIT \
  NO_TAKEOVER CLOCK_STOPS; do
  check lease fails Q=4 $mutation
done
for mutation in NO_ANNOUNCEMENT NO_PUBACK NO_MARKER OWN_SESSION KEEP_TENURE EARLY_PUBACK EPHEMERAL FORGET LOSE; do
  check journal fails NC=1 $mutation
done
check journal fails NC=1 EARLY_PUBACK OBSERVE
check journal fails NC=1 LOSE ONLY_RUNS
check journal fails NC=1 SENDS=0 SEQ NO_MARKER
check journal fails NC=1 SENDS=0 SEQ SEQ_BEFORE_ACK

if [ "${1:-}" = --large ]; then
  check lease holds Q=8
  check journal holds NC=1 FAULTS=4
  check journal holds NC=2 SENDS=1 FAULTS=1 BROKER_CRASHES=0
  check journal holds NC=1 FORGET BLIND_RULE
  check journal holds NC=1 EPHEMERAL BLIND_RULE
fi

echo "$((count - failed)) of $count as expected"
[ $failed -eq 0 ]
