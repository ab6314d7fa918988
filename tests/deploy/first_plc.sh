#!/bin/bash
# Runs docs/first-plc.md word for word, as root in a disposable bare root:
#   first_plc.sh < code blocks of the page, in order
# The root lacks three things that the page's reader has: a running systemd, the broker started by it, and a PLC. A
# replacement for systemctl starts the agent as the unit does; fxsim answers behind /dev/ttyUSB0.
set -euo pipefail

page=$(cat)
[ -n "$page" ] || { echo "first_plc: no commands on standard input" >&2; exit 2; }
apt-get install --yes --no-install-recommends mosquitto ./build/fxagent-sim_*.deb >/dev/null

cat >/usr/local/bin/systemctl <<'END'
#!/bin/sh
[ "$*" = "restart fxagent" ] || exit 1
setpriv --reuid=fxagent --regid=fxagent --init-groups fxagent run /etc/fxagent/agent.json >/tmp/agent.log 2>&1 </dev/null &
echo $! >/tmp/agent.pid
END
chmod +x /usr/local/bin/systemctl

PATH=$PATH:/usr/sbin mosquitto >/tmp/mosquitto.log 2>&1 &
broker=$!
mkfifo /tmp/ready
fxsim --plc name=press1,model=FX3U,pty=/tmp/press1,baud=9600,plant=demo >/tmp/ready &
plc=$!
trap 'kill "$broker" "$plc" $(cat /tmp/agent.pid 2>/dev/null) 2>/dev/null || true' EXIT
read -r _ </tmp/ready  # its single line: all ports are open
ln -s /tmp/press1 /dev/ttyUSB0
# A real port belongs to the group dialout.
port=$(readlink -f /dev/ttyUSB0)
chgrp dialout "$port"
chmod 660 "$port"

cd build
printf '%s\n' "$page" | bash -ex 2>&1 | tee /tmp/said
grep -qE '^press1 D100 = -?[0-9]+ ' /tmp/said || { echo "first_plc: no value was read" >&2; exit 1; }
grep -qE '^fx/line1/press1/data/\S+ .*"values":\{"counter":-?[0-9]+\}' /tmp/said ||
  { echo "first_plc: no sample arrived" >&2; tail -n 20 /tmp/agent.log >&2; exit 1; }
echo "first_plc: a value was read, and arrived over MQTT"
