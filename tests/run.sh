#!/bin/bash
# Builds everything and runs every test:
#   tests/run.sh [ctest arguments, such as -R Agenda or -L field]
# Installs what is missing first (only then as root). BUILD_DIR: the build directory, `build` in the
# project unless set. CMAKE_ARGS: more arguments of the configure, such as -DFXAGENT_SANITIZE=address.
# BUILD_TARGETS: what is built, where not everything is wanted.
# The last lines are ctest's own; so is the exit status.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build=${BUILD_DIR:-$root/build}

"$root/docker/install.sh" build test
# shellcheck disable=SC2086 # several arguments
cmake -S "$root" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=RelWithDebInfo ${CMAKE_ARGS:-}
# shellcheck disable=SC2086 # several targets
cmake --build "$build" ${BUILD_TARGETS:+--target $BUILD_TARGETS}
exec ctest --test-dir "$build" -j2 --output-on-failure --no-tests=error "$@"
