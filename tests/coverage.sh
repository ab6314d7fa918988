#!/bin/bash
# Line coverage of the tests, by module:
#   tests/coverage.sh [ctest arguments, such as -L unit]
# Builds everything for gcov in BUILD_DIR (build-coverage), runs the tests (by default the unit tests of all modules),
# and prints the fraction of covered lines for each module and in total. With BUILD_TARGETS only those targets are
# built and counted. HTML=DIR: also writes a page per file with all its lines. Failing tests end the script with
# ctest's exit status.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build=${BUILD_DIR:-$root/build-coverage}
[ $# -gt 0 ] || set -- -L 'unit|core|store|commands|cli|field|uplink'

cmake -S "$root" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Debug -DFXAGENT_COVERAGE=ON >/dev/null
# shellcheck disable=SC2086 # several targets
cmake --build "$build" ${BUILD_TARGETS:+--target $BUILD_TARGETS}
# Deletes the counts of earlier runs.
find "$build" -name '*.gcda' -delete
ctest --test-dir "$build" -j2 --output-on-failure --no-tests=error "$@"

gcovr=(gcovr --root "$root" --object-directory "$build" --exclude-throw-branches
       --gcov-ignore-parse-errors)
if [ -n "${HTML:-}" ]; then
  mkdir -p "$HTML"
  "${gcovr[@]}" --filter "$root/(protocol|agent)/" --html-details "$HTML/index.html" "$build" >/dev/null
fi
"${gcovr[@]}" --filter "$root/(protocol|agent)/" --csv - "$build" |
  awk -F, 'NR > 1 { room = $1; sub("/[^/]*$", "", room); lines[room] += $2; covered[room] += $3 }
    END { for (room in lines) print room, lines[room], covered[room] }' | sort |
  awk 'function row(room, lines, covered) {
      printf "%-18s %8d %8d %6.1f%%\n", room, lines, covered, lines ? 100 * covered / lines : 0 }
    BEGIN { printf "%-18s %8s %8s %7s\n", "room", "lines", "covered", "part" }
    { row($1, $2, $3); lines += $2; covered += $3 }
    END { row("all", lines, covered) }'
