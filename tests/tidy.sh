#!/bin/bash
# Runs clang-tidy with the checks of .clang-tidy on the files without coroutines and libraries: protocol/, the files
# in agent/ itself, its commands/, config/, import/, http/, recorder/ and remote/, and the pure units of field/.
#   tests/tidy.sh [FILE...]      only these files
# On coroutines clang-tidy does not terminate. BUILD_DIR: the configured directory with the compile commands,
# build-tidy by default; nothing is built. The last line counts files; exit status 0 only if there are no findings.
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
    'agent/http/*.cpp' 'agent/recorder/*.cpp' 'agent/remote/*.cpp' ':(glob)agent/*.cpp' ':!agent/agent.cpp' \
    agent/field/poll/{group_schedule,hole_map,line_share,poll_scheduler,report_by_exception}.cpp \
    agent/field/bus/{bus_doubt,echo,late_answers,overheard}.cpp agent/field/reconnect_policy.cpp)
fi

cmake -S "$root" -B "$build" -G Ninja -DCMAKE_CXX_COMPILER=clang++-19 -DFXAGENT_TESTS=OFF -DCMAKE_UNITY_BUILD=OFF \
  -DCMAKE_EXPORT_COMPILE_COMMANDS=ON >/dev/null
# Prints only the findings of each file: the count of warnings in system headers goes to standard error.
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
