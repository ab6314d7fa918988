#!/bin/bash
# Tests config/ansible on bare roots, as root and by hand; it takes some minutes:
#   tests/deploy/ansible_trial.sh PACKAGE.deb
# PACKAGE.deb: the package that docker/package.sh makes.
# Makes three roots of Debian 12 with only apt and python3, and runs ansible-playbook on them by chroot:
#   install.yml twice; the second run changes nothing
#   the files, their owners and modes; a config with errors, which is refused
#   upgrade.yml from an older version, with the second root unhealthy: it stops there, and the third keeps its version
# No systemd runs in these roots. A stand-in for systemctl starts and stops the agent.
# Needs root, mmdebstrap, permission to mount, and the package ansible.
# Exit status: 0 all passed, 1 a step failed, 2 wrong usage, 3 this machine cannot create such a root.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)

impossible() {
  echo "ansible_trial: cannot run here: $*" >&2
  exit 3
}
fail() {
  echo "ansible_trial: FAILED: $*" >&2
  exit 1
}

if [ "${1:-}" != --inside ]; then
  if [ $# -ne 1 ] || [ ! -f "$1" ]; then
    echo "usage: $0 PACKAGE.deb" >&2
    exit 2
  fi
  package=$(realpath "$1")
  [ "$(id -u)" -eq 0 ] || impossible "only root can"
  for program in mmdebstrap ansible-playbook; do
    command -v "$program" >/dev/null || impossible "$program is not installed"
  done
  ansible-doc -t connection -l 2>/dev/null | grep -q community.general.chroot ||
    impossible "ansible has no chroot connection (apt-get install ansible)"
  work=$(mktemp -d /var/tmp/fxagent-ansible-XXXXXX)
  trap 'rm -rf --one-file-system "$work"' EXIT
  # The mounts and processes end with their namespaces.
  unshare --mount --pid --fork --kill-child --mount-proc "${BASH_SOURCE[0]}" --inside "$work" "$package"
  exit
fi
work=$2 package=$3

# shellcheck source=tests/deploy/bare_root.sh
. "$root/tests/deploy/bare_root.sh"
make_base --include=python3,python3-apt
echo "ansible_trial: a bare Debian $(cat "$work/base/etc/debian_version")"

# The package with an earlier version number.
dpkg-deb --raw-extract "$package" "$work/tree"
sed -i 's/^Version:.*/Version: 0.0.1-1/' "$work/tree/DEBIAN/control"
dpkg-deb -Znone --root-owner-group --build "$work/tree" "$work/old.deb" >/dev/null

ports=()
for number in 1 2 3; do
  r=$work/edge$number
  cp -a --reflink=auto "$work/base" "$r"
  mount_kernel
  # The service of this root: one agent, by the unit's user.
  cat >"$r/usr/bin/systemctl" <<'STANDIN'
#!/bin/sh
# A stand-in for systemctl: the unit is the agent itself.
pid=$(cat /run/fxagent.pid 2>/dev/null)
if ! kill -0 "$pid" 2>/dev/null; then pid=; fi
stop() {
  [ -z "$pid" ] || kill "$pid"
  while [ -n "$pid" ] && kill -0 "$pid" 2>/dev/null; do sleep 0.1; done
}
start() {
  cd / && setsid setpriv --reuid=fxagent --regid=fxagent --init-groups \
    fxagent run /etc/fxagent/agent.json </dev/null >/var/log/fxagent.log 2>&1 &
  echo $! >/run/fxagent.pid
}
for word in "$@"; do
  case $word in
    start) [ -n "$pid" ] || start; exit 0 ;;
    restart) stop; start; exit 0 ;;
    stop) stop; exit 0 ;;
    reload) kill -HUP "$pid"; exit $? ;;
    is-active) [ -n "$pid" ]; exit $? ;;
    is-enabled) echo enabled; exit 0 ;;
    show) if [ -n "$pid" ]; then echo ActiveState=active; else echo ActiveState=inactive; fi
          echo LoadState=loaded; echo UnitFileState=enabled; exit 0 ;;
  esac
done
exit 0
STANDIN
  chmod 755 "$r/usr/bin/systemctl"
  # Ansible takes the service manager from this directory.
  mkdir -p "$r/run/systemd/system"
  ports+=("$(python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')")
done

cat >"$work/inventory.yml" <<YAML
gateways:
  vars:
    ansible_connection: community.general.chroot
    ansible_python_interpreter: /usr/bin/python3
    fxagent_deb: $work/old.deb
    fxagent_health_path: /healthz
    fxagent_health_url: "http://127.0.0.1:{{ port }}"
    fxagent_health_retries: 5
    fxagent_health_delay: 1
    fxagent_secrets: {mqtt_password: "secret of {{ inventory_hostname }}"}
    fxagent_acl_file: /etc/fxagent.acl
    fxagent_engineers: [ann]
    fxagent_config:
      agent: {id: "{{ name }}", root: fx/plant-a, remote_config: true}
      mqtt: {servers: ["mqtt://127.0.0.1:1"], username: "{{ name }}", password_file: mqtt_password}
      metrics: {listen: "127.0.0.1:{{ port }}"}
      store: {path: /var/lib/fxagent}
      links: []
      devices: []
  hosts:
    $work/edge1: {name: edge1, port: ${ports[0]}}
    $work/edge2: {name: edge2, port: ${ports[1]}}
    $work/edge3: {name: edge3, port: ${ports[2]}}
YAML
touch "$work/ansible.cfg"
playbook() { ANSIBLE_CONFIG=$work/ansible.cfg HOME=$work ansible-playbook -i "$work/inventory.yml" "$@"; }
# shellcheck disable=SC2016  # dpkg-query expands it
version_of() { chroot "$work/$1" dpkg-query --show --showformat='${Version}' fxagent; }

echo "ansible_trial: install.yml, first run"
playbook "$root/config/ansible/install.yml" | tee "$work/first" || fail "install.yml"
echo "ansible_trial: install.yml, second run"
playbook "$root/config/ansible/install.yml" >"$work/second" || { cat "$work/second"; fail "install.yml, second run"; }
sed -n '/PLAY RECAP/,$p' "$work/second"
[ "$(grep -c 'changed=0 .*failed=0' "$work/second")" -eq 3 ] || { cat "$work/second"; fail "the second run changes something"; }
for name in edge1 edge2 edge3; do
  [ "$(chroot "$work/$name" stat -c '%U %a' /etc/fxagent/mqtt_password)" = "fxagent 600" ] || fail "mode of the secret"
  [ "$(chroot "$work/$name" stat -c '%U %G %a' /etc/fxagent/agent.json)" = "root fxagent 640" ] || fail "mode of the config"
  [ "$(cat "$work/$name/etc/fxagent/mqtt_password")" = "secret of $work/$name" ] || fail "content of the secret"
  grep -q "^topic readwrite fx/plant-a/$name/config/desired" "$work/$name/etc/fxagent.acl" || fail "access rules"
  chroot "$work/$name" systemctl is-active fxagent || fail "$name does not run"
done

echo "ansible_trial: a config with errors"
before=$(sha256sum "$work/edge1/etc/fxagent/agent.json")
if playbook "$root/config/ansible/install.yml" --limit "$work/edge1" \
  -e '{"fxagent_config": {"agent": {"id": "edge1"}, "mqtt": {"servers": []}}}' >"$work/wrong"; then
  fail "a config with errors was accepted"
fi
[ "$before" = "$(sha256sum "$work/edge1/etc/fxagent/agent.json")" ] || fail "a config with errors was written"
grep -q 'failed to validate' "$work/wrong" || { cat "$work/wrong"; fail "another failure"; }

echo "ansible_trial: upgrade.yml, edge2 is not healthy"
# The agent of edge2 does not come back after its upgrade.
sed -i 's/^start() {/start() { return 0;/' "$work/edge2/usr/bin/systemctl"
chroot "$work/edge2" systemctl stop fxagent
if playbook "$root/config/ansible/upgrade.yml" -e "fxagent_deb=$package" >"$work/upgrade"; then
  cat "$work/upgrade"
  fail "upgrade.yml did not stop"
fi
sed -n '/PLAY RECAP/,$p' "$work/upgrade"
new=$(dpkg-deb --field "$package" Version)
[ "$(version_of edge1)" = "$new" ] || fail "edge1 has $(version_of edge1)"
[ "$(version_of edge2)" = "$new" ] || fail "edge2 has $(version_of edge2)"
[ "$(version_of edge3)" = 0.0.1-1 ] || fail "edge3 has $(version_of edge3)"
grep -q "^$work/edge3 " <(sed -n '/PLAY RECAP/,$p' "$work/upgrade") && fail "edge3 was touched"

echo "ansible_trial: upgrade.yml, edge2 is healthy again"
sed -i 's/^start() { return 0;/start() {/' "$work/edge2/usr/bin/systemctl"
chroot "$work/edge2" systemctl start fxagent
playbook "$root/config/ansible/upgrade.yml" -e "fxagent_deb=$package" >"$work/again" || { cat "$work/again"; fail "the second upgrade"; }
sed -n '/PLAY RECAP/,$p' "$work/again"
[ "$(version_of edge3)" = "$new" ] || fail "edge3 has $(version_of edge3)"
echo "ansible_trial: passed"
