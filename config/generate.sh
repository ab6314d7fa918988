#!/bin/bash
# Writes what is made from the key table and the catalogue: agent.schema.json, and the tables of README.md.
#   config/generate.sh [FXAGENT]      the program; build/agent/fxagent unless given
set -euo pipefail
cd "$(dirname "$0")"
fxagent=${1:-../build/agent/fxagent}
"$fxagent" schema >agent.schema.json
# Each table of the page begins with the same head; the program prints them in the page's order.
"$fxagent" schema --tables | awk '
  FNR == NR { if (/^\| key \|/) tables++; table[tables] = table[tables] $0 "\n"; next }
  /^\| key \|/ { printf "%s", table[++seen]; skip = 1; next }
  skip && /^\|/ { next }
  { skip = 0; print }
  END { if (seen != tables) { print "README.md has " seen " tables, not " tables >"/dev/stderr"; exit 1 } }
' - README.md >README.md.new
mv README.md.new README.md
