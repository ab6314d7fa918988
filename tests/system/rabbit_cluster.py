"""Three RabbitMQ nodes on the loopback, as Debian packages them (3.10: MQTT 3.1.1, quorum queues), without systemd.

Each node has its own directory, and a TCP proxy before its MQTT port, by which a test cuts it off from its clients. All
nodes use one epmd of their own, so they neither find nor disturb another RabbitMQ of the machine. Children are ended
by their pid, also if this process dies. The kernel ends a node with the thread that started it.

docs/operate/cluster.md shows CONFIG and POLICY as the config that was tested. Its script runs here as it stands there.
"""

import contextlib
import json
import os
import re
import secrets
import shutil
import signal
import socket
import struct
import subprocess
import sys
import threading
import time

import relays

sys.path.insert(0, os.path.join(os.path.dirname(__file__), "..", "support"))
from files import write_text
from ports import free_port, is_open
from waiting import wait_for

PROGRAM = "/usr/lib/rabbitmq/bin/rabbitmq-server"
EPMD = shutil.which("epmd")
# A node that was killed takes 8 s to come back, and sometimes 35 s on an idle machine.
START_PATIENCE = 180.0

CONFIG = """\
listeners.tcp = none
mqtt.listeners.tcp.default = 127.0.0.1:{mqtt_port}
mqtt.allow_anonymous = true
mqtt.durable_queue_type = quorum
# MQTT clients may send this many messages ahead of their acknowledgements.
mqtt.prefetch = 100
cluster_formation.peer_discovery_backend = classic_config
cluster_formation.discovery_retry_limit = 2
{peers}
# The minority of a split cluster stops; it would lose what it accepts.
cluster_partition_handling = pause_minority
# A node that does not answer counts as dead after this many seconds. The default is 60.
net_ticktime = {net_ticktime}
log.file.level = info
"""

ADVANCED = """\
[{kernel, [{inet_dist_use_interface, {127, 0, 0, 1}}]}].
"""

# A clean session of QoS 1 has a durable classic queue on the node of its connection. If that node dies, its client
# cannot subscribe on another node until the node is back ("home node … of durable queue … is down"), unless the queue
# has a mirror.
POLICY = ["set_policy", "mqtt-sessions", "^mqtt-subscription-",
          '{"ha-mode":"exactly","ha-params":2,"ha-sync-mode":"automatic"}', "--apply-to", "queues"]


# docs/operate/cluster.md lets a timer run its script on each node, this many seconds after its last run.
REJOIN_S = 10.0
PAGE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "docs", "operate", "cluster.md")


def rejoin_script():
    """Returns the script that the page shows. Here its commands systemctl and logger only print their arguments."""
    with open(PAGE) as page:
        script = re.search(r"^```\n(#!/bin/sh\n.*?)^```$", page.read(), re.DOTALL | re.MULTILINE).group(1)
    return 'systemctl() { echo "$*"; }\nlogger() { echo "$*" >&2; }\n' + script


def available():
    """True if this machine has RabbitMQ."""
    return os.path.exists(PROGRAM) and EPMD is not None


def mqtt_answers(port, patience=3.0):
    """True if the node accepts an MQTT 3.1.1 connection. That needs a majority of the nodes."""
    name = f"probe-{secrets.token_hex(4)}".encode()
    body = struct.pack("!H4sBBHH", 4, b"MQTT", 4, 2, 10, len(name)) + name
    with contextlib.suppress(OSError):
        with socket.create_connection(("127.0.0.1", port), patience) as connection:
            connection.settimeout(patience)
            connection.sendall(bytes([0x10, len(body)]) + body)
            answer = connection.recv(4)
            connection.sendall(b"\xe0\x00")
            return answer == b"\x20\x02\x00\x00"
    return False


class Proxy(relays.Relay):
    """The way to one node. cut_off() is a network that delivers nothing and reports nothing; it accepts connections, as
    the kernel of a paused machine does."""

    def __init__(self, cluster, node, upstream):
        super().__init__(cluster.loop, upstream)
        self.connects, self.node = cluster.connects, node
        self.is_cut = False

    def cut_off(self):
        self.loop.post(setattr, self, "is_cut", True)

    def heal(self):
        """Forwards again. Connections of the time before end, since their bytes are lost."""
        self.loop.post(setattr, self, "is_cut", False)
        self.cut()

    async def accepted(self, reader, writer):
        self.connects.append((time.monotonic(), self.node, writer.get_extra_info("peername")[1]))
        if self.is_cut:
            while await reader.read(65536):
                pass
            raise ConnectionResetError

    async def carry(self, up, down):
        await relays.until_one_ends(relays.forward(*up, self.arrives), relays.forward(*down, self.arrives))

    async def arrives(self, _data):
        return not self.is_cut


class Node:
    def __init__(self, cluster, number):
        self.cluster, self.number = cluster, number
        self.name = f"rmq{number}@localhost"
        self.directory = os.path.join(cluster.directory, f"node{number}")
        os.mkdir(self.directory)
        self.mqtt_port, self.amqp_port, self.dist_port = free_port(), free_port(), free_port()
        self.log_path = os.path.join(self.directory, "output.log")
        self.process = None
        self.proxy = Proxy(cluster, number, self.mqtt_port)
        self.lock = threading.RLock()  # of `process`: a Rejoin restarts the node in its own thread

    @property
    def port(self):
        """The port for clients: that of the proxy."""
        return self.proxy.port

    def write(self):
        peers = "\n".join(f"cluster_formation.classic_config.nodes.{n} = rmq{n}@localhost"
                          for n in range(1, len(self.cluster.nodes) + 1))
        for name, text in (("rabbitmq.conf", CONFIG.format(mqtt_port=self.mqtt_port, peers=peers,
                                                            net_ticktime=self.cluster.net_ticktime)),
                           ("advanced.config", ADVANCED), ("enabled_plugins", "[rabbitmq_mqtt].\n")):
            write_text(os.path.join(self.directory, name), text)

    def environment(self):
        at = lambda name: os.path.join(self.directory, name)
        return {
            "PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "LANG": "C.UTF-8",
            "HOME": self.cluster.directory,  # of the cookie
            "ERL_EPMD_PORT": str(self.cluster.epmd_port), "ERL_EPMD_ADDRESS": "127.0.0.1",
            "RABBITMQ_NODENAME": self.name, "RABBITMQ_NODE_PORT": str(self.amqp_port),
            "RABBITMQ_DIST_PORT": str(self.dist_port), "RABBITMQ_MNESIA_BASE": at("mnesia"),
            "RABBITMQ_LOG_BASE": at("log"), "RABBITMQ_CONFIG_FILE": at("rabbitmq.conf"),
            "RABBITMQ_ADVANCED_CONFIG_FILE": at("advanced.config"),
            "RABBITMQ_ENABLED_PLUGINS_FILE": at("enabled_plugins"),
            "RABBITMQ_CONF_ENV_FILE": "/dev/null",
            # The script then becomes the node, so that its pid is that of the node.
            "RUNNING_UNDER_SYSTEMD": "true",
            # Three nodes with a scheduler for each core would spin on each other's time.
            "RABBITMQ_SERVER_ADDITIONAL_ERL_ARGS": "+sbwt none +sbwtdcpu none +sbwtdio none",
        }

    def start(self):
        """Starts the node; wait() returns when it serves."""
        with open(self.log_path, "a") as log:
            self.process = subprocess.Popen(["setpriv", "--pdeathsig", "KILL", PROGRAM], env=self.environment(),
                                            cwd=self.directory, stdin=subprocess.DEVNULL, stdout=log, stderr=log)

    def wait(self, patience=START_PATIENCE):
        """Returns when the node accepts MQTT connections. A node that ended by itself is started again: it does so
        if it does not find the others in time."""
        deadline = time.monotonic() + patience
        while not mqtt_answers(self.mqtt_port):
            if time.monotonic() > deadline:
                raise AssertionError(f"{self.name} was not up after {patience:.0f} s:\n{self.logged()[-5000:]}")
            if self.cluster.closing.wait(0.1):
                raise AssertionError("the cluster is being closed")
            with self.lock:
                if self.process.poll() is not None:
                    self.start()
        self.proxy.listen()

    def kill(self):
        with self.lock:
            if self.process is None:
                return
            self.process.kill()
            self.process.wait()
            self.process = None
            self.proxy.refuse()

    def pause(self):
        self.process.send_signal(signal.SIGSTOP)

    def resume(self):
        self.process.send_signal(signal.SIGCONT)

    def split(self):
        """Cuts the node off from the other nodes, not from its clients. It notices at once."""
        self._set_cookie_of_others("split")

    def join(self):
        """Ends a split()."""
        with open(os.path.join(self.cluster.directory, ".erlang.cookie")) as cookie:
            self._set_cookie_of_others(cookie.read())

    def _set_cookie_of_others(self, cookie):
        others = ", ".join(f"'{node.name}'" for node in self.cluster.nodes if node is not self)
        self.cluster.control(self, "--quiet", "eval", f"[begin erlang:set_cookie(Node, '{cookie}'), "
                             f"erlang:disconnect_node(Node) end || Node <- [{others}]].")

    def restart(self):
        """Does what `systemctl restart` does, and returns when the node serves. Returns False if it had to be killed."""
        with self.lock:
            is_clean = False
            with contextlib.suppress(subprocess.SubprocessError):
                self.cluster.control(self, "stop")
                self.process.wait(90)  # TimeoutStopSec of systemd
                is_clean = True
            self.kill()
            self.start()
            self.wait()
            return is_clean

    def rejoin(self):
        """Runs the script of docs/operate/cluster.md. Returns what it says: nothing if all is fine, or the arguments of its
        systemctl and its messages to the log."""
        environment = self.environment()
        environment["PATH"] = "/usr/lib/rabbitmq/bin:" + environment["PATH"]
        try:
            return subprocess.run(["sh", "-c", rejoin_script()], env=environment, stdin=subprocess.DEVNULL, text=True,
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=60).stdout
        except subprocess.TimeoutExpired:
            return "killed after TimeoutStartSec\n"

    def logged(self):
        out = ""
        for name in (self.log_path, os.path.join(self.directory, "log", self.name + ".log")):
            with contextlib.suppress(FileNotFoundError):
                with open(name, errors="replace") as text:
                    out += text.read()
        return out


class Rejoin:
    """The timer of docs/operate/cluster.md on one node, in a thread, and what systemd does when its script asks for a
    restart. A node that the thread has started ends with it."""

    def __init__(self, node):
        self.node = node
        self.last = (0.0, "")  # when the last run began, and what it said: nothing if all is fine
        self.restarts, self.killed = 0, 0  # restarts, and how many of them were not clean
        self.failed = None  # the exception that has ended the timer
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self):
        try:
            cluster = self.node.cluster
            cluster.closing.wait(REJOIN_S * self.node.number / len(cluster.nodes))  # not all at the same time
            while not cluster.closing.wait(REJOIN_S):
                self._check()
        except Exception as error:
            self.failed = error

    def _check(self):
        began = time.monotonic()
        said = self.node.rejoin()
        self.last = (began, said)
        if said:
            with open(os.path.join(self.node.directory, "rejoin.log"), "a") as log:
                log.write(f"{time.strftime('%T')} {said}")
        if "restart --no-block rabbitmq-server" in said:
            self.restarts += 1
            self.killed += not self.node.restart()


class RabbitCluster:
    """The nodes are numbered from 1. Use it as a context: the end of the block ends all processes."""

    def __init__(self, directory, nodes=3, net_ticktime=4):
        self.net_ticktime = net_ticktime
        self.directory = os.path.join(directory, "rabbit")
        os.mkdir(self.directory)
        write_text(os.path.join(self.directory, ".erlang.cookie"), secrets.token_hex(20), 0o400)
        self.loop = relays.Loop()  # of the proxies
        self.connects = []  # (time, node, port of the client) of each TCP connection that a proxy has accepted
        self.epmd_port = free_port()
        self.epmd = None
        self.nodes = [Node(self, number) for number in range(1, nodes + 1)]
        self.timers = []
        self.closing = threading.Event()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def start(self):
        """Starts the nodes one after the other, and returns when each accepts MQTT connections. If two new nodes of
        3.10 join within a second, one of them may stay outside of the MQTT plugin's own Raft cluster. It then refuses
        every MQTT connection ("client ID registration timed out") for good."""
        environment = {"PATH": os.environ.get("PATH", ""), "ERL_EPMD_RELAXED_COMMAND_CHECK": "true"}
        self.epmd = subprocess.Popen(["setpriv", "--pdeathsig", "KILL", EPMD, "-address", "127.0.0.1",
                                      "-port", str(self.epmd_port)], env=environment,
                                     stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.wait_for_epmd()
        for node in self.nodes:
            node.write()
            node.start()
            node.wait()
        self.control(self.nodes[0], *POLICY)

    def wait_for_epmd(self):
        """Returns when it accepts connections. A node that finds none starts a daemon of its own."""
        def serves():
            assert self.epmd.poll() is None, "epmd has ended"
            return is_open(self.epmd_port)
        wait_for("epmd", serves, START_PATIENCE)

    def wait_until_whole(self, patience):
        """Waits until each classic queue has a mirror with all its messages, and each quorum queue all its nodes. A
        node that fails before may take messages with it. Returns the queues that are not whole in time."""
        deadline = time.monotonic() + patience
        while True:
            waiting = [queue for queue in self._queues() if not self._is_whole(queue)]
            if not waiting or time.monotonic() > deadline:
                return waiting
            time.sleep(0.5)

    def _queues(self):
        """Returns all queues. While the cluster does not answer, they are one that is not whole."""
        try:
            return json.loads(self.control(self.nodes[0], "--quiet", "list_queues", "name", "type", "online",
                                           "synchronised_slave_pids", "--formatter", "json"))
        except (subprocess.SubprocessError, ValueError):
            return [{"name": "no answer"}]

    def _is_whole(self, queue):
        if queue.get("type") == "quorum":
            return len(queue.get("online", "")) == len(self.nodes)
        return bool(queue.get("synchronised_slave_pids"))

    def start_timers(self):
        self.timers = [Rejoin(node) for node in self.nodes]

    def restarts(self):
        return sum(timer.restarts for timer in self.timers)

    def wait_until_fine(self, patience=300.0):
        """Returns when each node reaches all others, and after that the script of each timer found nothing."""
        deadline = time.monotonic() + patience
        see_all = None
        while not see_all or not all(began > see_all and not said for began, said in [timer.last for timer in self.timers]):
            for timer in self.timers:
                if timer.failed:
                    raise timer.failed
            assert time.monotonic() < deadline, f"the timers said {[timer.last[1] for timer in self.timers]}"
            if not see_all and all(self.evaluate(node, "length(rabbit_mnesia:cluster_nodes(running)).") == len(self.nodes)
                                   for node in self.nodes):
                see_all = time.monotonic()
            time.sleep(0.1)

    def routes(self):
        """Returns how many routes each node has; None: no answer. After a pause they may differ. A message then reaches
        only the queues that the publisher's own node knows."""
        return [self.evaluate(node, "ets:info(rabbit_route, size).") for node in self.nodes]

    def evaluate(self, node, expression):
        """Returns the number that an Erlang expression yields on a node; None: no answer."""
        with contextlib.suppress(subprocess.SubprocessError, ValueError):
            return int(self.control(node, "--quiet", "eval", expression))
        return None

    def servers(self, first=0):
        """Returns `mqtt.servers` of an agent that begins with node `first` + 1."""
        turned = self.nodes[first % len(self.nodes):] + self.nodes[:first % len(self.nodes)]
        return [f"mqtt://127.0.0.1:{node.port}" for node in turned]

    def control(self, node, *arguments):
        """Returns the output of rabbitmqctl."""
        return subprocess.run(["/usr/lib/rabbitmq/bin/rabbitmqctl", "--timeout", f"{START_PATIENCE:.0f}", *arguments],
                              env=node.environment(), stdin=subprocess.DEVNULL, capture_output=True, text=True,
                              timeout=START_PATIENCE, check=True).stdout

    def close(self):
        self.closing.set()
        for timer in self.timers:
            timer.thread.join()
        for node in self.nodes:
            with contextlib.suppress(Exception):
                node.kill()
        if self.epmd is not None:
            self.epmd.kill()
            self.epmd.wait()
            self.epmd = None
        self.loop.close()


def main():
    """Starts a cluster, prints its ports, kills each node in turn and prints when it serves again."""
    import tempfile
    with tempfile.TemporaryDirectory(prefix="fxagent-rabbit-") as directory, RabbitCluster(directory) as cluster:
        begin = time.monotonic()
        cluster.start()
        print(f"up after {time.monotonic() - begin:.1f} s: {' '.join(cluster.servers())}", flush=True)
        for node in cluster.nodes:
            node.kill()
            node.start()
            begin = time.monotonic()
            node.wait()
            print(f"{node.name} killed and back after {time.monotonic() - begin:.1f} s", flush=True)
        print(cluster.control(cluster.nodes[0], "cluster_status"))


if __name__ == "__main__":
    main()
