#!/bin/bash
# Runs clang-tidy with the checks of .clang-tidy over the files without coroutines: protocol/, the root files of agent/,
# its commands/, config/, import/, metrics/ and remote/, and the pure units of field/. Not yet those of store/,
# uplink/ and cli/.
#   tests/tidy.sh [FILE...]      these files only
# It does not come to an end on coroutines. BUILD_DIR: where its commands are configured, build-tidy unless set; nothing
# is built. The last line counts files; exit status 0 only if nothing was found.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build=${BUILD_DIR:-$root/build-tidy}
cd "$root"

tidy=$(command -v clang-tidy-19 || true)
if [ -z "$tidy" ]; then
  echo "no clang-tidy-19 here: docker/install.sh ci" >&2
  exit 1
fi

files=("$@")
if [ ${#files[@]} -eq 0 ]; then
  mapfile -t files < <(git ls-files 'protocol/*.cpp' 'agent/commands/*.cpp' 'agent/config/*.cpp' 'agent/import/*.cpp' \
    'agent/metrics/*.cpp' 'agent/remote/*.cpp' ':(glob)agent/*.cpp' ':!agent/agent.cpp' \
    agent/field/{bus_doubt,hole_map,poll_scheduler,reconnect_policy,report_by_exception}.cpp)
fi

cmake -S "$root" -B "$build" -G Ninja -DCMAKE_CXX_COMPILER=clang++-19 -DFXAGENT_TESTS=OFF \
  -DCMAKE_EXPORT_COMPILE_COMMANDS=ON >/dev/null
# Of each file only what was found: the count of warnings in system headers goes to standard error.
check() {
  said=$("$1" --quiet -p "$2" "$3" 2>&1) && return
  printf '%s\n' "$said"
  echo "FAILED $3"
  return 1
}
export -f check
log=$build/tidy.log
printf '%s\n' "${files[@]}" | xargs -P "$(nproc)" -I '{}' bash -c 'check "$@"' - "$tidy" "$build" '{}' | tee "$log" || true
failed=$(grep -c '^FAILED ' "$log" || true)
echo "$((${#files[@]} - failed)) passed, $failed failed"
[ "$failed" -eq 0 ]
