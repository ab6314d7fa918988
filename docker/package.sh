#!/bin/sh
# Builds the Debian packages of this tree in the build directory: fxagent_VERSION_ARCHITECTURE.deb, fxagent-sim with
# the simulator, and fxagent-history with the history in a database:
#   docker/package.sh
# Installs missing packages first (only then as root). BUILD_DIR: the build directory, `build` in the project by
# default; an existing build is reused. The last lines name the packages.
# HOST_ARCH: the target architecture, in the environment provided by docker/cross.sh.
set -eu

root=$(cd "$(dirname "$0")/.." && pwd)
architecture=${HOST_ARCH:-$(dpkg --print-architecture)}
FXAGENT_BUILD_DIR=${BUILD_DIR:-$root/build}
# As dpkg-buildpackage sets it: no step needs root.
DEB_RULES_REQUIRES_ROOT=no
export FXAGENT_BUILD_DIR DEB_RULES_REQUIRES_ROOT

[ -n "${HOST_ARCH:-}" ] || "$root/docker/install.sh" build package
# debhelper builds with another HOME, which has no compiler cache.
[ -n "${CCACHE_DIR:-}" ] || CCACHE_DIR=$(ccache --get-config cache_dir)
export CCACHE_DIR
cd "$root"
mkdir -p "$FXAGENT_BUILD_DIR"
packages="fxagent fxagent-sim fxagent-history"
for name in $packages; do rm -f "$FXAGENT_BUILD_DIR/${name}_"*"_$architecture.deb"; done
# Removes debhelper's staging files and its marks of completed steps. Its own `clean` would search the whole tree for
# backup copies.
tidy() { rm -rf debian/fxagent debian/fxagent-sim debian/fxagent-history debian/pages debian/.debhelper debian/files debian/debhelper-build-stamp debian/*.substvars debian/*.debhelper debian/*.debhelper.log; }
tidy
# The output is long and only of interest after a failure.
log=$FXAGENT_BUILD_DIR/package.log
if ! dpkg-architecture --host-arch "$architecture" --command "debian/rules binary" >"$log" 2>&1; then
  tail -n 40 "$log" >&2
  exit 1
fi
tidy
for name in $packages; do ls "$FXAGENT_BUILD_DIR/${name}_"*"_$architecture.deb"; done
