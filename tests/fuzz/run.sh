#!/bin/bash
# Builds the fuzz targets with clang, ASan and UBSan, and runs each for a while:
#   tests/fuzz/run.sh [--seconds N] [TARGET...]
# 20 s each by default; the targets are decode, import, inputs, profile, recording, store and stream. libFuzzer writes interesting
# inputs to BUILD_DIR (build-fuzz) for the next run; the corpus here is only read. An input that fails is kept there too, and
# its file is named. CMAKE_ARGS: additional arguments of the configure step. JOBS: number of parallel targets, one per
# core by default. The last line counts targets; exit status 0 only if all passed.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(cd "$here/../.." && pwd)
build=${BUILD_DIR:-$root/build-fuzz}
seconds=20
at_a_time=${JOBS:-$(nproc)}
targets=()
while [ $# -gt 0 ]; do
  case $1 in
    --seconds)
      seconds=${2:?--seconds takes a number}
      shift 2
      ;;
    -*)
      echo "usage: tests/fuzz/run.sh [--seconds N] [decode|import|inputs|profile|recording|store|stream...]" >&2
      exit 2
      ;;
    *)
      targets+=("$1")
      shift
      ;;
  esac
done
[ ${#targets[@]} -gt 0 ] || targets=(decode import inputs profile recording store stream)

clang=$(command -v clang++-19 || command -v clang++ || true)
if [ -z "$clang" ]; then
  echo "no clang++ here, and libFuzzer comes with it: docker/install.sh ci" >&2
  exit 1
fi
# shellcheck disable=SC2086 # several arguments
cmake -S "$root" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=RelWithDebInfo -DCMAKE_CXX_COMPILER="$clang" \
  -DFXAGENT_FUZZ=ON -DFXAGENT_SANITIZE=address ${CMAKE_ARGS:-}
cmake --build "$build" --target "${targets[@]/%/_fuzz}"

# Runs one target; libFuzzer's output goes to a file and is printed at the end.
fuzz() {
  local target=$1 kept=$build/fuzz-corpus/$1 quiet=()
  mkdir -p "$kept"
  # Leaves out the log lines of these.
  if [ "$target" = store ] || [ "$target" = profile ]; then quiet=(-close_fd_mask=2); fi
  # An input takes less than a second, even with sanitizers; after 30 s it hangs, however busy the machine is.
  exec "$build/tests/fuzz/${target}_fuzz" -max_total_time="$seconds" -timeout=30 -rss_limit_mb=1024 \
    -verbosity=0 -print_final_stats=1 -artifact_prefix="$build/fuzz-$target-" "${quiet[@]}" \
    "$kept" "$here/corpus/$target" >"$build/fuzz-$target.log" 2>&1
}

running=()
trap '[ ${#running[@]} -eq 0 ] || kill "${running[@]}" 2>/dev/null || true' EXIT
passed=0 failed=0
for ((i = 0; i < ${#targets[@]}; i += at_a_time)); do
  running=()
  now=("${targets[@]:i:at_a_time}")
  echo "== ${now[*]}, $seconds s"
  for target in "${now[@]}"; do
    fuzz "$target" &
    running+=($!)
  done
  for n in "${!now[@]}"; do
    target=${now[n]} status=0
    wait "${running[n]}" || status=$?
    sed "s/^/$target: /" "$build/fuzz-$target.log"
    if [ $status -eq 0 ]; then
      passed=$((passed + 1))
    else
      echo "FAILED $target: the input is in $build/fuzz-$target-*" >&2
      failed=$((failed + 1))
    fi
  done
done
running=()
echo "$passed passed, $failed failed"
[ "$failed" -eq 0 ]
