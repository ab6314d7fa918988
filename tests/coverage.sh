#!/bin/bash
# Which lines the tests run, by room:
#   tests/coverage.sh [ctest arguments, such as -L unit]
# Builds everything for gcov in BUILD_DIR (build-coverage), runs the tests (the unit tests of all rooms
# unless said otherwise), and prints the covered part of the lines of each room, then of all. With
# BUILD_TARGETS only those are built, and what was not built counts for nothing. HTML=DIR: a page for
# each file there, with every line. Tests that fail end it, with ctest's exit status.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build=${BUILD_DIR:-$root/build-coverage}
[ $# -gt 0 ] || set -- -L 'unit|core|store|commands|cli|field|uplink'

cmake -S "$root" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Debug -DFXAGENT_COVERAGE=ON >/dev/null
# shellcheck disable=SC2086 # several targets
cmake --build "$build" ${BUILD_TARGETS:+--target $BUILD_TARGETS}
# What an earlier run counted is not this one's.
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
