#!/bin/bash
# Takes the pictures of the page, docs/pictures/page-*.png, from a page that is open to this machine:
#   docs/pictures/take.sh URL [TOKEN]
# Start config/demo/run.sh first and wait until it pulls the cable of the meter; it prints URL and token. With the token, a command is
# sent from the page. Needs chromium and node (docker/packages.txt), and the
# packages of tests/system/peers/browser from npm.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(cd "$here/../.." && pwd)
url=${1:?usage: take.sh URL [TOKEN]}
token=${2:-}
modules=$(mktemp -d)
trap 'rm -rf "$modules"' EXIT
"$root/tests/npm.sh" "$root/tests/system/peers/browser" "$modules"

# One picture: a view, its size and colours, and a condition that the view is complete.
picture() {
  printf '{"open": "%s#%s", "width": %d, "height": %d, "scheme": "%s"}\n' "$url" "$2" "$3" "$4" "$5"
  printf '{"until": "document.querySelectorAll(\\"main h1, main h2\\").length > 0 && document.body.innerText.includes(\\"running for\\")"}\n'
  if [ "$2" = values ]; then
    printf '{"until": "document.querySelectorAll(\\".row\\").length > 3"}\n'
    printf '{"click": ".row:nth-of-type(2) input"}\n{"click": ".row:nth-of-type(3) input"}\n'
    # A curve begins when the page opens.
    printf '{"click": "button"}\n{"until": "(document.querySelector(\\".plot path\\")?.getAttribute(\\"d\\").match(/L/g) ?? []).length > 24"}\n'
  elif [ "$2" = lines ]; then
    printf '{"until": "document.body.innerText.includes(\\"Since the start\\")"}\n'
  elif [ "$1" = frames ]; then
    printf '{"until": "document.querySelectorAll(\\".frame\\").length > 20"}\n'
    printf '{"until": "document.querySelectorAll(\\".frame\\")[document.querySelectorAll(\\".frame\\").length - 6].open = true"}\n'
    printf '{"until": "document.querySelector(\\".frames\\").scrollIntoView() || true"}\n'
  elif [ "$2" = commands ] && [ -n "$token" ]; then
    printf '{"fill": "label:nth-of-type(3) input", "text": "setpoint"}\n{"fill": "label:nth-of-type(4) input", "text": "65"}\n'
    printf '{"click": "form.command button"}\n{"fill": "dialog input", "text": "%s"}\n' "$token"
    printf '{"shot": "%s/page-%s-asks.png"}\n' "$here" "$1"
    printf '{"click": "dialog button.main"}\n{"until": "document.body.innerText.includes(\\"page:\\")"}\n'
  fi
  printf '{"shot": "%s/page-%s.png"}\n' "$here" "$1"
}
{
  picture now now 1100 760 light
  picture values values 1100 760 light
  picture lines lines 1100 760 light
  picture frames lines/line1 1100 620 light
  picture commands commands 1100 760 light
  picture config config 1100 620 dark
  picture phone values 390 760 dark
} | node "$root/tests/system/peers/browser/browser.js" "$modules" | sed -n '/"error"/p'
