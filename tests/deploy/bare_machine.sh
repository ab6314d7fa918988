#!/bin/bash
# Tests the documented commands on a bare Debian 12: creates a root with only apt in it, clones the checkout's last
# commit into it, and runs a new user's commands there by chroot:
#   tests/deploy/bare_machine.sh [demo|tests|package|docker|all]… [-- CTEST ARGUMENTS]
# demo     config/demo/run.sh, and the time until the first live value
# tests    tests/run.sh, with the ctest arguments
# package  README.md, Install, word for word, which builds and installs the package; then --version, check of the
#          example, the recipe of docs/operate/brokers-and-access.md against the mosquitto it configures, lintian,
#          systemd-analyze, tests/deploy/package_trial.py (upgrade, remove, purge, a signed repository), and
#          docs/first-plc.md word for word
# docker   every stage of docker/Dockerfile: with buildah if it is installed, otherwise its COPY and RUN lines
# all      all of them (the default)
# Each runs in its own root. Only what package managers need to reach their sources is copied in: this machine's
# settings and certificates. Only caches are shared: packages, npm's, the compiler's.
#
# Needs root, mmdebstrap and permission to mount. Mounts and processes are in a mount and a PID namespace that end
# with the script, and the roots are always removed.
# Exit status: 0 all passed, 1 a step failed, 2 wrong usage, 3 this machine cannot create such a root.
# BARE_CACHE: the directory of the caches (~/.cache/fxagent-bare). CCACHE_DIR: the compiler's cache, if elsewhere.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]:-$0}")/../.." && pwd)

impossible() {
  echo "bare_machine: cannot create a bare root here: $*" >&2
  exit 3
}

# --- outside: namespaces, and what is removed when they are gone --------------------------------------

outside() {
  local want=() mode
  while [ $# -gt 0 ] && [ "$1" != -- ]; do
    case $1 in
      demo | tests | package | docker) want+=("$1") ;;
      all) want+=(demo tests package docker) ;;
      -h | --help) sed -n '2,/^set /{/^#/s/^# \{0,1\}//p}' "${BASH_SOURCE[0]}"; exit 0 ;;
      *) echo "usage: $0 [demo|tests|package|docker|all]… [-- CTEST ARGUMENTS]" >&2; exit 2 ;;
    esac
    shift
  done
  [ $# -eq 0 ] || shift
  [ ${#want[@]} -gt 0 ] || want=(demo tests package docker)

  [ "$(id -u)" -eq 0 ] || impossible "only root can"
  command -v mmdebstrap >/dev/null || impossible "mmdebstrap is not installed (docker/install.sh ci)"
  unshare --mount --pid --fork mount -t tmpfs none /mnt 2>/dev/null || impossible "mounting is not allowed"

  cache=${BARE_CACHE:-${HOME:-/root}/.cache/fxagent-bare}
  mkdir -p "$cache/debs/partial" "$cache/npm" "${CCACHE_DIR:=$cache/ccache}"
  export CCACHE_DIR
  # Removes the leftovers of a killed run: their lock is free.
  local old
  while read -r old; do
    if flock --nonblock "$old" true; then rm -rf --one-file-system "$old"; fi
  done < <(find /var/tmp -maxdepth 1 -name 'fxagent-bare-*' -mmin +1)
  work=$(mktemp -d /var/tmp/fxagent-bare-XXXXXX)
  exec 9<"$work"
  flock 9
  child=''
  trap 'rm -rf --one-file-system "$work" || { sleep 1; rm -rf --one-file-system "$work"; }' EXIT
  trap '[ -z "$child" ] || kill -KILL "$child" 2>/dev/null; wait; exit 1' INT TERM HUP
  local status=0
  setpriv --pdeathsig KILL unshare --mount --pid --fork --kill-child --mount-proc \
    "${BASH_SOURCE[0]}" --inside "$work" "$cache" "${want[*]}" "$@" &
  child=$!
  wait "$child" || status=$?
  exit "$status"
}

# --- inside the namespaces ----------------------------------------------------------------------------

# make_base and mount_kernel
# shellcheck source=tests/deploy/bare_root.sh
[ "${1:-}" != --inside ] || . "$root/tests/deploy/bare_root.sh"

# Creates a root named $1 with the clone in /src, and mounts what a kernel and an init provide. The images are built in
# /src, too: the compiler's cache serves both only there, because CMake's unity files contain the path.
make_root() {
  r=$work/$1
  cp -a --reflink=auto "$work/base" "$r"
  mount_kernel
  mkdir -p "$r/root/.npm" "$r/root/.cache/ccache"
  mount --bind "$cache/debs" "$r/var/cache/apt/archives"
  mount --bind "$cache/npm" "$r/root/.npm"
  mount --bind "$CCACHE_DIR" "$r/root/.cache/ccache"
  git clone --quiet --upload-pack "git -c safe.directory=* upload-pack" "file://$root" "$r/src"
  git -C "$r/src" remote remove origin
}

drop_root() {
  local process place
  for process in /proc/[0-9]*; do
    if [ "$(readlink "$process/root")" = "$r" ]; then kill -KILL "${process#/proc/}" 2>/dev/null || true; fi
  done
  # Lazily, because killed processes may not have ended yet.
  for place in proc sys dev run var/cache/apt/archives root/.npm root/.cache/ccache; do
    if mountpoint -q "$r/$place"; then umount -R --lazy "$r/$place"; fi
  done
  rm -rf --one-file-system "$r"
}

# Runs a command in the current root, in the clone, with the environment of a login and nothing else. If the caller
# has no home, neither has the command. Locale and time zone are the caller's.
in_root() {
  local name settings=()
  [ -z "${HOME:-}" ] || settings+=(HOME=/root)
  for name in http_proxy https_proxy no_proxy LANG LC_ALL TZ; do
    [ -z "${!name:-}" ] || settings+=("$name=${!name}")
  done
  env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin TERM=dumb "${settings[@]}" \
    chroot "$r" /bin/sh -c 'cd /src && exec "$@"' sh "$@" </dev/null
}

# Prints a code block of a file's section by number: code_block FILE SECTION NUMBER
code_block() {
  local block
  block=$(awk -v section="## $2" -v wanted="$3" '
    /^## / { inside = ($0 == section) }
    inside && /^```/ { open = !open; if (open) n++; next }
    inside && open && n == wanted' "$root/$1")
  [ -n "$block" ] || { echo "bare_machine: $1 has no code block $3 below $2" >&2; return 1; }
  echo "$block"
}

show_demo() {
  local log=$work/demo.log first
  in_root config/demo/run.sh --seconds 20 2>&1 | tee "$log"
  first=$(sed -nE 's/^\[ *([0-9]+) s\] the first live values.*/\1/p' "$log")
  echo "bare_machine: demo: from the clone to the first live value: $first s"
  # Printed without a check: the speed of this machine does not depend on the clone.
  [ -n "$first" ]
}

show_tests() { in_root tests/run.sh "$@"; }

show_package() {
  local block
  block=$(code_block README.md Install 1)
  echo "$block"
  in_root sh -exc "$block"
  in_root fxagent --version
  in_root fxagent check config/agent.example.json
  show_acl
  in_root docker/install.sh repository proof
  in_root sh -exc 'lintian --fail-on error,warning --tag-display-limit 0 build/fxagent_*.deb build/fxagent-sim_*.deb \
      build/fxagent-history_*.deb
    apt-get install --yes ./build/fxagent-sim_*.deb
    fxsim --version
    fxagent check /usr/share/doc/fxagent-sim/examples/demo.json
    apt-get install --yes --no-install-recommends ./build/fxagent-history_*.deb
    fxhistory --help
    systemd-analyze verify --man=no /lib/systemd/system/fxhistory@all.service
    apt-get purge --yes fxagent-sim fxagent-history
    systemd-analyze verify --man=no /lib/systemd/system/fxagent.service
    systemd-analyze security --offline=true --threshold=25 --no-pager /lib/systemd/system/fxagent.service | tail -n 1'
  in_root sh -c 'python3 -B tests/deploy/package_trial.py build/fxagent_*.deb'
  show_first_plc
}

# docs/first-plc.md: the reader's commands, from the package to the first value.
show_first_plc() {
  local page=docs/first-plc.md
  { code_block "$page" "1. Install" 1 && code_block "$page" "3. Write the config and read one value" 1 &&
    code_block "$page" "4. Start the agent and see the value" 1; } >"$r/root/first_plc"
  in_root sh -c 'tests/deploy/first_plc.sh </root/first_plc'
}

# The recipe of docs/operate/brokers-and-access.md, "Who may do what", word for word. Certificates and passwords are
# created here, because the document leaves them to the user.
show_acl() {
  in_root docker/install.sh demo
  in_root sh -exc "jq '.mqtt += {username: \"edge7\"}' config/agent.example.json >agent.json
    apt-get install --yes --no-install-recommends openssl
    openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 -subj /CN=ca \
      -keyout /root/ca.key -out /etc/mosquitto/ca.pem
    openssl req -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -subj /CN=localhost \
      -addext subjectAltName=DNS:localhost,IP:127.0.0.1 -keyout /etc/mosquitto/server.key -out /root/server.csr
    openssl x509 -req -in /root/server.csr -CA /etc/mosquitto/ca.pem -CAkey /root/ca.key -CAcreateserial -days 2 \
      -copy_extensions copy -out /etc/mosquitto/server.pem
    chown mosquitto /etc/mosquitto/server.key
    install -d -o mosquitto /run/mosquitto" >"$work/acl.log" 2>&1 || { tail -n 20 "$work/acl.log"; return 1; }
  # mosquitto_passwd asks on a terminal, twice for each of the four users.
  code_block docs/operate/brokers-and-access.md "Who may do what" 1 >"$r/root/recipe.sh"
  in_root tests/deploy/type_passwords.sh /root/recipe.sh secret-of-the-test
  code_block docs/operate/brokers-and-access.md "Who may do what" 2 >"$r/etc/mosquitto/conf.d/fxagent.conf"
  in_root tests/deploy/acl_recipe.sh secret-of-the-test
}

show_docker() {
  if command -v buildah >/dev/null; then build_images; else run_stages; fi
}

# The stages that become images; the other stages are built for them.
build_images() {
  local stage container driver=overlay
  # Its leftovers after a kill are removed with everything else.
  export TMPDIR=$work/images-tmp
  mkdir -p "$TMPDIR"
  local buildah=(buildah --root "$work/images" --runroot "$work/images-run")
  # Each layer is a full copy if the file system supports nothing better.
  "${buildah[@]}" --storage-driver "$driver" info >/dev/null 2>&1 || driver=vfs
  buildah+=(--storage-driver "$driver")
  slim_base
  container=$("${buildah[@]}" from scratch)
  "${buildah[@]}" copy --quiet "$container" "$work/slim" / >/dev/null
  "${buildah[@]}" commit --quiet --rm "$container" bare-base >/dev/null
  rm -rf "$work/slim"
  for stage in sim broker agent; do
    echo "bare_machine: docker: stage $stage, images as $driver"
    "${buildah[@]}" bud --layers --isolation chroot --format docker --build-arg BASE=localhost/bare-base \
      --target "$stage" --tag "$stage" --volume "$cache/debs:/var/cache/apt/archives" \
      --volume "$CCACHE_DIR:/root/.cache/ccache" \
      --file "$root/docker/Dockerfile" "$root" >"$work/bud.log" 2>&1 || { tail -n 20 "$work/bud.log"; return 1; }
    # shellcheck disable=SC2046 # a program and its argument
    "${buildah[@]}" run --isolation chroot "$("${buildah[@]}" from "localhost/$stage")" -- $(first_words "$stage")
  done
  "${buildah[@]}" push --quiet localhost/agent "dir:$work/pushed" && image_size "$work/pushed"
}

# The base without the files that debian:12-slim leaves out, also those of later packages and of apt's caches, so that
# an image built on it has its real size.
slim_base() {
  local part
  cp -a --reflink=auto "$work/base" "$work/slim"
  for part in doc groff info linda lintian locale man; do echo "path-exclude /usr/share/$part/*"; done \
    >"$work/slim/etc/dpkg/dpkg.cfg.d/docker"
  echo 'path-include /usr/share/doc/*/copyright' >>"$work/slim/etc/dpkg/dpkg.cfg.d/docker"
  find "$work/slim/usr/share/doc" ! -type d ! -name copyright -delete
  for part in groff info linda lintian locale man; do rm -rf "$work/slim/usr/share/$part"; done
  printf 'Dir::Cache::%s "";\n' pkgcache srcpkgcache >"$work/slim/etc/apt/apt.conf.d/docker-clean"
}

# For an image pushed to a directory: prints the size of its layers (the first is the base) on disk and as fetched.
image_size() {
  local layer plain fetched first='' plain_sum=0 fetched_sum=0
  while read -r layer; do
    fetched=$(stat --format=%s "$1/$layer")
    plain=$(gzip --decompress --stdout "$1/$layer" | wc --bytes)
    if [ -z "$first" ]; then
      first="$((plain / 1000)) kB of Debian, $((fetched / 1000)) kB fetched"
    else
      plain_sum=$((plain_sum + plain)) fetched_sum=$((fetched_sum + fetched))
    fi
  done < <(grep -o '"digest": *"sha256:[0-9a-f]*"' "$1/manifest.json" | grep -o '[0-9a-f]\{64\}' | tail -n +2)
  echo "bare_machine: docker: the agent's image has $first; on it $((plain_sum / 1000)) kB, $((fetched_sum / 1000)) kB fetched"
}

# Checks that the program of an image finds everything it needs.
first_words() {
  case $1 in
    sim) echo fxsim --version ;;
    broker) echo which mosquitto_passwd ;;
    agent) echo fxagent --version ;;
  esac
}

# The Dockerfile's own lines in separate roots, limited to FROM, WORKDIR, COPY and RUN.
run_stages() {
  local word rest stage='' directory=/ from source last
  # The current root without a clone in it.
  in_stage() { env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root \
    chroot "$r" /bin/sh -ec "cd $directory; $1" </dev/null; }
  while read -r word rest; do
    case $word in
      FROM)
        from=${rest%% AS *}; stage=${rest##* AS }; directory=/; r=$work/stage-$stage
        echo "bare_machine: docker: stage $stage"
        # shellcheck disable=SC2016 # the Dockerfile's own variable
        if [ "$from" = '${BASE}' ]; then from=base; else from=stage-$from; directory=/src; fi
        cp -a --reflink=auto "$work/$from" "$r"
        cp -a /dev/null /dev/urandom "$r/dev/" 2>/dev/null || true ;;
      WORKDIR) directory=$rest; mkdir -p "$r$directory" ;;
      COPY)
        from=$root
        case $rest in --from=*) from=${rest%% *}; from=$work/stage-${from#--from=}; rest=${rest#* } ;; esac
        last=${rest##* }
        case $last in /*) ;; *) last=$directory/$last ;; esac
        case $last in */) mkdir -p "$r$last" ;; *) mkdir -p "$r${last%/*}" ;; esac
        # shellcheck disable=SC2086 # a pattern
        for source in ${rest% *}; do cp -a "$from"/$source "$r$last"; done ;;
      RUN) in_stage "$rest" ;;
      ENTRYPOINT)
        # shellcheck disable=SC2046 # a program and its argument
        chroot "$r" $(first_words "$stage") ;;
    esac
  done < <(sed -e ':a' -e '/\\$/{N;s/\\\n//;ba' -e '}' "$root/docker/Dockerfile" | grep -vE '^(#|$)')
}

inside() {
  work=$1 cache=$2
  local modes=$3 mode began failed=()
  shift 3
  began=$SECONDS
  # shellcheck disable=SC2119 # its arguments are others
  make_base
  echo "bare_machine: a bare Debian $(cat "$work/base/etc/debian_version") after $((SECONDS - began)) s," \
    "$(chroot "$work/base" dpkg-query --show | wc -l) packages"
  for mode in $modes; do
    echo
    echo "bare_machine: $mode"
    began=$SECONDS
    # Not in a condition: the steps have to end at the first failure.
    set +e
    (set -e; [ "$mode" = docker ] || make_root "$mode"; "show_$mode" "$@")
    local status=$?
    set -e
    r=$work/$mode
    if [ -d "$r" ]; then drop_root; fi
    if [ $status -eq 0 ]; then
      echo "bare_machine: $mode passed, $((SECONDS - began)) s"
    else
      echo "bare_machine: $mode FAILED, $((SECONDS - began)) s"
      failed+=("$mode")
    fi
  done
  [ ${#failed[@]} -eq 0 ] || { echo "bare_machine: failed: ${failed[*]}"; exit 1; }
}

if [ "${1:-}" = --inside ]; then
  shift
  inside "$@"
else
  outside "$@"
fi
