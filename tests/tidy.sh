#!/bin/bash
# Runs clang-tidy with the checks of .clang-tidy on the files without coroutines and libraries: protocol/, the files
# in agent/ itself, its commands/, config/, import/, http/, recorder/ and remote/, and the pure units of field/.
#   tests/tidy.sh                the files of a folder together, which takes less time
#   tests/tidy.sh --each         each file by itself: it must also include what it uses
#   tests/tidy.sh FILE...        only these files, each by itself
# On coroutines clang-tidy does not terminate. BUILD_DIR: the configured directory with the compile commands,
# build-tidy by default; nothing is built. The last line counts files; exit status 0 only if there are no findings.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build=${BUILD_DIR:-$root/build-tidy}
together=5  # files at most
cd "$root"

tidy=$(command -v clang-tidy-19 || true)
if [ -z "$tidy" ]; then
  echo "no clang-tidy-19 here: docker/install.sh ci" >&2
  exit 1
fi

if [ "${1:-}" = --each ] || [ $# -gt 0 ]; then together=1; fi
[ "${1:-}" != --each ] || shift
files=("$@")
if [ ${#files[@]} -eq 0 ]; then
  mapfile -t files < <(git ls-files 'protocol/*.cpp' 'agent/commands/*.cpp' 'agent/config/*.cpp' 'agent/import/*.cpp' \
    'agent/http/*.cpp' 'agent/recorder/*.cpp' 'agent/remote/*.cpp' ':(glob)agent/*.cpp' ':!agent/agent.cpp' \
    agent/field/poll/{group_schedule,hole_map,poll_scheduler,report_by_exception}.cpp \
    agent/field/bus/overheard.cpp agent/field/link/reconnect_policy.cpp)
fi

cmake -S "$root" -B "$build" -G Ninja -DCMAKE_CXX_COMPILER=clang++-19 -DFXAGENT_TESTS=OFF -DCMAKE_UNITY_BUILD=OFF \
  -DCMAKE_EXPORT_COMPILE_COMMANDS=ON >/dev/null

# A line for each batch: the source that includes its files, then the files. It is compiled like the first of them.
# The two codecs in fx/ use the same names for different things.
rm -rf "$build/batches"
mkdir -p "$build/batches"
printf '%s\n' "${files[@]}" | awk -v at="$build/batches" -v root="$root" -v most="$together" '
  { folder = $0; sub("/[^/]*$", "", folder) }
  folder != last || count == most || folder == "protocol/fx" { batch = at "/" ++batches ".cpp"; last = folder; count = 0; line[batches] = batch }
  { count++; line[batches] = line[batches] " " $0; print "#include \"" root "/" $0 "\"" >batch }
  END { for (i = 1; i <= batches; i++) print line[i] }' >"$build/batches/list"
while read -r batch first _; do
  jq --arg batch "$batch" --arg first "$root/$first" \
    '.[] | select(.file == $first) | .command |= gsub($first; $batch) | .file = $batch' "$build/compile_commands.json"
done <"$build/batches/list" | jq --slurp . >"$build/batches/compile_commands.json"

# Prints only the findings of each batch: the count of warnings in system headers goes to standard error.
check() {
  local tidy=$1 batches=$2 said
  shift 2
  said=$("$tidy" --quiet --config-file=.clang-tidy -p "$batches" "$1" 2>&1) && return
  printf '%s\n' "$said"
  shift
  printf 'FAILED %s\n' "$@"
  return 1
}
export -f check
log=$build/tidy.log
# shellcheck disable=SC2016 # the words of the inner shell
xargs -P "$(nproc)" -L 1 bash -c 'check "$@"' - "$tidy" "$build/batches" <"$build/batches/list" | tee "$log" || true
failed=$(grep -c '^FAILED ' "$log" || true)
echo "$((${#files[@]} - failed)) passed, $failed failed"
[ "$failed" -eq 0 ]
