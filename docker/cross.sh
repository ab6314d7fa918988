#!/bin/bash
# Builds the package for a gateway with another processor, and tests it in an emulator:
#   docker/cross.sh arm64|armhf
# It works in its own Debian 12 root and does not change this machine's packages. It compiles the last commit there
# with Debian's cross compiler and the libraries of the other processor. It then installs the package and runs its
# program under qemu: --version, check, decode, and an agent that polls and commands the simulator of this machine
# (fxsim, native) through a broker. Serial ports cannot be tested, because qemu 7.2 does not support their ioctls.
# The package is left in the build directory. Run by hand, not by CI: the first run takes some twenty minutes on two
# cores, later ones five, thanks to the compiler cache.
#
# Needs root, mmdebstrap and permission to mount. BUILD_DIR: the build directory with a native fxsim, `build` in the
# project by default. BARE_CACHE: the directory of the caches (~/.cache/fxagent-bare). JOBS: number of parallel
# compilers.
# Exit status: 0 built and tested, 1 a step failed, 2 wrong usage, 3 this machine cannot create such a root.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build=${BUILD_DIR:-$root/build}

impossible() {
  echo "cross: cannot create a bare root here: $*" >&2
  exit 3
}
# make_base and mount_kernel
# shellcheck source=tests/deploy/bare_root.sh
. "$root/tests/deploy/bare_root.sh"

say() { printf 'cross: %4d s  %s\n' "$SECONDS" "$*"; }

outside() {
  case ${1:-} in
    arm64) gnu=aarch64-linux-gnu emulator=qemu-aarch64-static ;;
    armhf) gnu=arm-linux-gnueabihf emulator=qemu-arm-static ;;
    *) echo "usage: $0 arm64|armhf" >&2; exit 2 ;;
  esac
  [ "$(id -u)" -eq 0 ] || impossible "only root can"
  command -v mmdebstrap >/dev/null || impossible "mmdebstrap is not installed (docker/install.sh ci)"
  unshare --mount --pid --fork mount -t tmpfs none /mnt 2>/dev/null || impossible "mounting is not allowed"
  [ -x "$build/tests/sim/fxsim" ] || { echo "cross: there is no $build/tests/sim/fxsim: run config/demo/run.sh" >&2; exit 1; }
  cache=${BARE_CACHE:-${HOME:-/root}/.cache/fxagent-bare}
  mkdir -p "$cache/debs-$1/partial" "$cache/ccache"
  # Removes the leftovers of a killed run: their lock is free.
  local child='' old
  while read -r old; do
    if flock --nonblock "$old" true; then rm -rf --one-file-system "$old"; fi
  done < <(find /var/tmp -maxdepth 1 -name 'fxagent-cross-*' -mmin +1)
  work=$(mktemp -d /var/tmp/fxagent-cross-XXXXXX)
  exec 9<"$work"
  flock 9
  trap 'rm -rf --one-file-system "$work" || { sleep 1; rm -rf --one-file-system "$work"; }' EXIT
  trap '[ -z "$child" ] || kill -KILL "$child" 2>/dev/null; wait; exit 1' INT TERM HUP
  setpriv --pdeathsig KILL unshare --mount --pid --fork --kill-child --mount-proc \
    "${BASH_SOURCE[0]}" --inside "$work" "$cache" "$1" "$gnu" "$emulator" &
  child=$!
  wait "$child"
  cp "$work"/out/*.deb "$build/"
  say "$(cd "$build" && ls -l "$PWD"/fxagent_*"_$1.deb")"
}

in_root() {
  env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root TERM=dumb \
    DEBIAN_FRONTEND=noninteractive CMAKE_BUILD_PARALLEL_LEVEL="${JOBS:-$(nproc)}" \
    chroot "$r" /bin/sh -c 'cd /root/fxagent && exec "$@"' sh "$@" </dev/null
}

# The build section of packages.txt as packages for this processor (tools, and architecture-independent headers) and
# for the other.
build_packages() {
  local name
  # shellcheck disable=SC2013 # words
  for name in $(sed -n 's/([^)]*)//g; s/^build://p' "$root/docker/packages.txt"); do
    case $name in
      g++) echo "g++-$gnu" ;;
      *-dev) in_root apt-cache show --no-all-versions "$name" |
        awk -v "name=$name" -v "arch=$arch" '/^Architecture:/ { print $2 == "all" ? name : name ":" arch }' ;;
      *) echo "$name" ;;
    esac
  done
}

inside() {
  work=$1 cache=$2 arch=$3 gnu=$4 emulator=$5
  # A program compiled against the release also runs with its updates, and not every mirror has the updates of each
  # architecture.
  suites=
  make_base --architectures="$(dpkg --print-architecture),$arch"
  r=$work/base
  mount_kernel
  mkdir -p "$r/root/.cache/ccache" "$work/out"
  mount --bind "$cache/debs-$arch" "$r/var/cache/apt/archives"
  mount --bind "$cache/ccache" "$r/root/.cache/ccache"
  git -c safe.directory='*' clone --quiet --upload-pack "git -c safe.directory=* upload-pack" "file://$root" "$r/root/fxagent"
  say "a bare root for $arch"
  in_root apt-get update >"$work/apt.log" 2>&1 || impossible "apt-get update failed there"
  # shellcheck disable=SC2046 # a list of names
  in_root apt-get install --yes --no-install-recommends $(build_packages) debhelper dpkg-dev qemu-user-static \
    mosquitto mosquitto-clients jq >"$work/apt.log" 2>&1 || { tail -n 20 "$work/apt.log"; exit 1; }
  say "compiler and libraries"
  in_root env HOST_ARCH="$arch" FXAGENT_EMULATOR="$emulator" BUILD_DIR="/root/fxagent/build-$arch" docker/package.sh
  cp "$r/root/fxagent/build-$arch/"fxagent*.deb "$work/out/"
  say "the package"
  in_root sh -c "apt-get install --yes --no-install-recommends ./build-$arch/fxagent_*_$arch.deb" >"$work/apt.log" 2>&1 ||
    { tail -n 20 "$work/apt.log"; exit 1; }
  # shellcheck disable=SC2016 # dpkg's own
  say "installed; it depends on $(in_root dpkg-query --show --showformat='${Depends}' "fxagent:$arch")"
  cp "$build/tests/sim/fxsim" "$r/usr/local/bin/"
  in_root docker/cross_trial.sh "$emulator"
  say "tried under $emulator"
}

if [ "${1:-}" = --inside ]; then
  shift
  inside "$@"
else
  outside "$@"
fi
