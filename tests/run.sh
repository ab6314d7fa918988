#!/bin/bash
# Builds everything and runs all tests:
#   tests/run.sh [ctest arguments, such as -R PollScheduler or -L field]
# Installs missing packages first (only then as root). BUILD_DIR: the build directory, `build` in the project by
# default. CMAKE_ARGS: additional arguments of the configure step, such as -DFXAGENT_SANITIZE=address. BUILD_TARGETS:
# targets to build instead of everything; then nothing is fetched from npm. BUILD_ONLY: if set, no test runs. JOBS:
# number of parallel tests, three per core by default. TMPDIR: the directory of the tests' files, in memory by default.
# FXAGENT_TEST_SEED: repeats the random tests of a run that printed it.
# The last lines are ctest's own, followed by the names of skipped tests. The exit status is ctest's.
# Up to three system tests that failed run once more, alone and with the same seed, and are named if they pass then:
# on a busy machine one of their peers may stall for longer than the test allows.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build=${BUILD_DIR:-$root/build}

"$root/docker/install.sh" build test
# shellcheck disable=SC2086 # several arguments
cmake -S "$root" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=RelWithDebInfo -DFXAGENT_TESTS=ON ${CMAKE_ARGS:-}
if [ -z "${BUILD_TARGETS:-}" ]; then
  "$root/tests/npm.sh" "$root/tests/system/peers/node" "$build/npm/peers"
  "$root/tests/npm.sh" "$root/tests/system/peers/node-red" "$build/npm/node-red"
  "$root/tests/npm.sh" "$root/tests/system/peers/browser" "$build/npm/browser"
  "$root/tests/npm.sh" "$root/tests/system/peers/describe" "$build/npm/describe"
fi
# shellcheck disable=SC2086 # several targets
cmake --build "$build" ${BUILD_TARGETS:+--target $BUILD_TARGETS}
[ -z "${BUILD_ONLY:-}" ] || exit 0

# Their stores are in memory: what a build has written can hold up an fsync for seconds, and tests measure time.
memory=$(df --output=avail -B 1M /dev/shm 2>/dev/null | tail -n 1) || memory=0
if [ -z "${TMPDIR:-}" ] && [ "$memory" -ge 2000 ]; then export TMPDIR=/dev/shm; fi
# Tests of the whole agent mostly wait; tests that measure time run alone.
export FXAGENT_TEST_SEED=${FXAGENT_TEST_SEED:-$((RANDOM * 32768 + RANDOM))}
echo "random tests: FXAGENT_TEST_SEED=$FXAGENT_TEST_SEED"
status=0
# A test without its own limit is ended after 300 s.
ctest --timeout 300 --test-dir "$build" -j"${JOBS:-$((3 * $(nproc)))}" --output-on-failure --no-tests=error "$@" || status=$?
# Prints why a Python test skipped itself, and the skipped tests of a program that is one entry of ctest.
sed -nE "s/^(test_\S+ \([^)]*\)) \.\.\. (skipped .*)/\1: \2/p" "$build/Testing/Temporary/LastTest.log"
awk '/^[0-9]+\/[0-9]+ Testing: / { entry = $3 }
     /^\[  SKIPPED \] .* \([0-9]+ ms\)$/ && $4 != entry { print $4 ": skipped, in " entry }' "$build/Testing/Temporary/LastTest.log"

if [ $status -ne 0 ]; then
  mapfile -t failed < <(sed -E 's/^[0-9]+://' "$build/Testing/Temporary/LastTestsFailed.log")
  others=$(printf '%s\n' "${failed[@]}" | grep -cv '^system\.' || true)
  if [ ${#failed[@]} -gt 0 ] && [ ${#failed[@]} -le 3 ] && [ "$others" -eq 0 ]; then
    printf '\nOnce more, by themselves: %s\n' "${failed[*]}"
    status=0
    ctest --timeout 300 --test-dir "$build" --rerun-failed --output-on-failure --no-tests=error || status=$?
    [ $status -ne 0 ] || printf 'failed beside others, passed by itself: %s\n' "${failed[@]}"
  fi
fi
exit $status
