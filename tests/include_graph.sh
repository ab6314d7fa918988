#!/bin/bash
# Prints which room includes which, and in how many lines:
#   tests/include_graph.sh [ROOT]
#   agent/field -> protocol  12
# A room is a directory with sources; what is no header of this project is left out.
set -euo pipefail

cd "${1:-$(dirname "${BASH_SOURCE[0]}")/..}"
grep -rnE --include=*.h --include=*.cpp '^[[:space:]]*#[[:space:]]*include[[:space:]]*"' protocol agent tests |
  sed -E 's#^([^:]+)/[^/:]+:[0-9]+:[^"]*"([^"]+)/[^/"]+".*#\1 -> \2#' |
  awk '$1 != $3' | sort | uniq -c | awk '{ printf "%-20s -> %-20s %4d\n", $2, $4, $1 }'
