#!/bin/bash
# Writes the files and tables that the program generates: config/agent.schema.json, the tables of keys in docs/config/keys.md,
# and the table of subcommands in docs/operate/command-line.md.
#   config/generate.sh [FXAGENT [ROOT]]
# FXAGENT: the program, build/agent/fxagent by default. ROOT: the tree to write to, the project by default.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
fxagent=${1:-$root/build/agent/fxagent}
root=${2:-$root}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Puts the tables on standard input, which all begin with the line $2, in the place of the tables of the page $1.
replace_tables() {
  awk -v head="$2" -v page="$1" '
    FNR == NR { if ($0 == head) tables++; table[tables] = table[tables] $0 "\n"; next }
    $0 == head { printf "%s", table[++seen]; skip = 1; next }
    skip && /^\|/ { next }
    { skip = 0; print }
    END { if (seen != tables || tables == 0) { print page " has " seen + 0 " of " tables + 0 " tables" >"/dev/stderr"; exit 1 } }
  ' - "$1" >"$work/page"
  cat "$work/page" >"$1"
}

commands_head='| subcommand | does | options |'
table_of_commands() {
  local name names
  names=$("$fxagent" --help | sed -n '/^Subcommands:/,/^$/s/^  \([a-z-]*\)  .*/\1/p')
  [ -n "$names" ] || { echo "$fxagent --help names no subcommands" >&2; return 1; }
  echo "$commands_head"
  echo '|---|---|---|'
  for name in $names; do
    "$fxagent" "$name" --help | awk '
      NR == 1 { does = $0 }
      sub(/^Usage: fxagent /, "") { sub(/ \[OPTIONS\]/, ""); call = $0 }
      /^$/ { inside = 0 }
      inside && $1 ~ /^--/ && $1 != "--version" { options = options (options ? " " : "") "`" $1 "`" }
      /^Options:/ { inside = 1 }
      END { print "| `" call "` | " does " | " options " |" }'
  done
}

"$fxagent" schema >"$work/schema"
cat "$work/schema" >"$root/config/agent.schema.json"
"$fxagent" schema --tables >"$work/keys"
table_of_commands >"$work/commands"
replace_tables "$root/docs/config/keys.md" '| key | type, range | default | meaning |' <"$work/keys"
replace_tables "$root/docs/operate/command-line.md" "$commands_head" <"$work/commands"
