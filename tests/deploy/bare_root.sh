# shellcheck shell=bash disable=SC2154
# A bare Debian 12 in a directory, for scripts that source this file: tests/deploy/bare_machine.sh and
# docker/cross.sh. They set `work`, a directory of their own, and for mount_kernel `r`, the root. They define
# impossible(), which prints why no root can be created and exits.

# Creates a root in $work/base with only apt, from this machine's sources for Debian 12. Arguments go to mmdebstrap.
# suites: a pattern of the suites to use; empty: only the release.
make_base() {
  local beside=${suites-'(-updates|-security)?'}
  # shellcheck disable=SC2016 # apt's own variables
  apt-get indextargets --format '$(REPO_URI) $(RELEASE) $(COMPONENT)' 'Created-By: Packages' |
    awk -v wanted="^bookworm$beside\$" '$2 ~ wanted { print "deb", $1, $2, $3 }' | sort -u >"$work/sources"
  [ -s "$work/sources" ] || impossible "apt knows no source of Debian 12 (bookworm); apt-get update?"
  apt-config dump --format '%F "%v";%n' Acquire |
    grep -E '^Acquire::(http|https|Check|Retries|ForceIPv)' >"$work/acquire" || true
  if ! mmdebstrap --quiet --variant=minbase --mode=root --format=directory "$@" bookworm "$work/base" \
    --aptopt="$(cat "$work/acquire")" --dpkgopt=force-unsafe-io "$work/sources" >"$work/mmdebstrap.log" 2>&1; then
    # The package sources are local to this machine.
    tail -n 5 "$work/mmdebstrap.log" | sed -E 's#[a-z+]+://[^ ]+#(source)#g' >&2
    impossible "mmdebstrap failed"
  fi
  local base=$work/base file
  cp "$work/acquire" "$base/etc/apt/apt.conf.d/99carried"
  # As in Debian's images: a disposable root needs no fsync for each file.
  echo force-unsafe-io >"$base/etc/dpkg/dpkg.cfg.d/unsafe-io"
  for file in /etc/apt/auth.conf /etc/apt/auth.conf.d /etc/resolv.conf /etc/hosts; do
    [ ! -e "$file" ] || cp -RL "$file" "$base${file%/*}/"
  done
  # Certificates of this machine: the package ca-certificates includes them when it is installed.
  mkdir -p "$base/usr/local/share/ca-certificates"
  find /usr/local/share/ca-certificates -name '*.crt' -exec cp {} "$base/usr/local/share/ca-certificates/" \;
  local key value
  for key in registry proxy https-proxy noproxy cafile; do
    value=$(npm config get "$key" 2>/dev/null) || value=
    case $value in '' | null | undefined) ;; *) echo "$key=$value" >>"$base/root/.npmrc" ;; esac
  done
}

# Mounts what a kernel and an init provide in the root $r.
mount_kernel() {
  mount -t proc proc "$r/proc"
  mount -t sysfs -o ro sysfs "$r/sys"
  mount -t tmpfs -o mode=755 dev "$r/dev"
  local node
  for node in null zero full random urandom tty; do cp -a "/dev/$node" "$r/dev/"; done
  mkdir "$r/dev/pts" "$r/dev/shm"
  mount -t devpts -o newinstance,gid=5,mode=620,ptmxmode=666 devpts "$r/dev/pts"
  mount -t tmpfs -o mode=1777 shm "$r/dev/shm"
  ln -s pts/ptmx "$r/dev/ptmx"
  ln -s /proc/self/fd "$r/dev/fd"
  ln -s fd/0 "$r/dev/stdin"; ln -s fd/1 "$r/dev/stdout"; ln -s fd/2 "$r/dev/stderr"
  mount -t tmpfs -o mode=755 run "$r/run"
}
