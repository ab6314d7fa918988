#!/bin/bash
# Draws the includes between folders, as a mermaid diagram between two comments of docs/design.md:
#   tests/include_graph.sh            writes it there
#   tests/include_graph.sh --check    fails if the diagram does not match the sources
#   tests/include_graph.sh --lines    prints every pair and its number of lines, including the tests
# `values` stands for line_time and the files in agent/ itself, except agent.cpp and reload.cpp, which connect
# everything. An arrow is omitted if others lead the same way: a --> c next to a --> b --> c. Of two folders that
# include each other (a <--> b), the first has their other arrows.
set -euo pipefail

export LC_ALL=C  # order of names
cd "$(dirname "${BASH_SOURCE[0]}")/.."
page=docs/design.md
first='<!-- includes: tests/include_graph.sh -->' last='<!-- end of includes -->'

# Prints one line for each of our #includes: the two files. Arguments: what grep reads.
includes() {
  grep -rnE --include=*.h --include=*.cpp '^[[:space:]]*#[[:space:]]*include[[:space:]]*"' "$@" |
    sed -E 's#^([^:]+):[0-9]+:[^"]*"([^"]+)".*#\1 \2#'
}

# line_time is a separate node: it is the only file in agent/ that uses the config.
graph() {
  echo "$first"
  echo '```mermaid'
  echo 'graph LR'
  includes protocol agent --exclude=agent.cpp --exclude=agent.h --exclude=reload.cpp --exclude=reload.h |
    sed -E 's#protocol/[^ ]+#protocol#g; s#agent/line_time\.[a-z]+#line_time#g; s#agent/([a-z_]+)/[^ ]+#\1#g
            s#agent/[^ ]+#values#g' | awk '$1 != $2' | sort -u |
    awk '
      { from[++n] = $1; to[n] = $2; way[$1, $2]; folder[$1]; folder[$2] }
      # True if other arrows lead from a to c.
      function is_led(a, c, b) {
        for (b in folder) if (name[b] == b && b != a && b != c && (a, b) in way && (b, c) in way) return 1
        return 0
      }
      # As many per line as fit the page.
      function say(arrows) {
        if (length(text) + length(arrows) > 110) { print text; text = "" }
        text = text "  " arrows ";"
      }
      END {
        for (b in folder) for (a in folder) for (c in folder) if ((a, b) in way && (b, c) in way) way[a, c]
        for (a in folder) name[a] = a
        for (a in folder) for (b in folder) if ((a, b) in way && (b, a) in way && b < name[a]) name[a] = b
        for (i = 1; i <= n; i++) {
          a = name[from[i]]; c = name[to[i]]
          if (a == c && from[i] < to[i]) say(from[i] " <--> " to[i])
          if (a == c || drawn[a, c]++ || is_led(a, c)) continue
          if (!(a in line)) nodes[++count] = a
          line[a] = line[a] (line[a] == "" ? "" : " & ") c
        }
        for (i = 1; i <= count; i++) say(nodes[i] " --> " line[nodes[i]])
        print text
      }'
  echo '```'
  echo "$last"
}

# The page with the graph replacing the text between the comments.
page_with_graph() {
  if ! grep -qxF -e "$first" "$page" || ! grep -qxF -e "$last" "$page"; then
    echo "include_graph: $page has no lines '$first' and '$last'" >&2
    return 1
  fi
  drawn=$(graph)
  awk -v first="$first" -v last="$last" -v drawn="$drawn" '
    $0 == first { print drawn; within = 1 }
    !within { print }
    $0 == last { within = 0 }' "$page"
}

case ${1:-} in
  '')
    page_with_graph >"$page.new"
    mv "$page.new" "$page"
    ;;
  --check)
    if ! page_with_graph | diff -u "$page" - >&2; then
      echo "include_graph: $page does not show what the sources include; call tests/include_graph.sh" >&2
      exit 1
    fi
    ;;
  --lines)
    includes protocol agent tests | sed -E 's#/[^/ ]+( |$)#\1#g' | awk '$1 != $2' | sort | uniq -c | awk '{ printf "%-20s -> %-20s %4d\n", $2, $3, $1 }'
    ;;
  *)
    echo "usage: tests/include_graph.sh [--check|--lines]" >&2
    exit 2
    ;;
esac
