"""A quiet connection: a command is read at once after any silence. The MQTT library's reading thread never spins,
whatever happens to the broker. The library itself polls for 1 s and sleeps 100 ms after each poll without data
(agent/uplink/paho/reading_thread.h)."""

import os
import time
import unittest

from broker_test import tls_conf
from plant import BASE, PlantTest, device, free_port, frozen, read_text, tag, tcp_link, wait_for
from mqtt_packets import PINGRESP, packet
from scripted_broker import Script, ScriptedBroker

# From the last packet on the connection to the next.
SILENCES_MS = range(900, 1200, 10)
# A command takes a few ms. After the silences in ASLEEP_MS the library's sleep would delay it by more than LATE_MS.
LATE_MS = 15
ASLEEP_MS = range(1000, 1090, 10)
# Commands that other load on the machine may delay.
BUSY = 3

POLLS = 20  # of a group at 100 ms: 2 s
MOST_TICKS = 20  # of 10 ms, in that time; a spinning thread has more than 100


class QuietConnection(PlantTest):
    def test_no_silence_makes_a_command_wait(self):
        # Otherwise the broker would hold back the second of two messages for 40 ms.
        self.start([device(interval_ms=3600000)], broker_conf="set_tcp_nodelay true")
        self.ready()
        self.command(op="force_on", address="M150")
        late = []
        for silence_ms in SILENCES_MS:
            time.sleep(silence_ms / 1000)
            sent = time.monotonic()
            self.succeed(op="force_on", address="M150")
            if time.monotonic() - sent > LATE_MS / 1000:
                late.append(silence_ms)
        # A busy machine delays commands after any silence.
        asleep = [ms for ms in late if ms in ASLEEP_MS]
        self.assertLessEqual(len(asleep), BUSY + (len(late) - len(asleep)) // 2, f"late after {late} ms")


class Scripted(ScriptedBroker):
    """Behaves like the broker of a PlantTest."""

    def kill(self):
        self.close()


class Reader(PlantTest):
    """CPU time of the reading thread while the agent polls its device this many times."""

    def start_plant(self, devices=(), plcs=(), links=(), **mqtt_config):
        self.start_sim([self.plc(), *plcs])
        # An unchanged value is not published.
        groups = [{"name": "fast", "interval_ms": 100, "publish": "on_change"}]
        self.start_agent([device(groups=groups), *devices], [self.serial(), *links], mqtt_config)

    def polls(self):
        return self.sim.stats()["requests"]["read"]

    def wait_polls(self, count):
        polls = self.polls()
        wait_for("polls", lambda: self.polls() >= polls + count)

    def ticks(self):
        """Returns utime and stime of proc(5)."""
        for number in os.listdir(f"/proc/{self.agent.process.pid}/task"):
            name, fields = read_text(f"/proc/{self.agent.process.pid}/task/{number}/stat").rsplit(")", 1)
            if name.endswith("(MQTTAsync_rcv"):
                return int(fields.split()[11]) + int(fields.split()[12])
        raise AssertionError("no thread reads")

    def assert_waits(self, what):
        before = self.ticks()
        self.wait_polls(POLLS)
        self.assertLessEqual(self.ticks() - before, MOST_TICKS, what)

    def unread(self):
        """Returns the bytes from the broker that the agent has not read: proc_net_tcp."""
        with open("/proc/net/tcp") as table:
            for row in table.read().splitlines()[1:]:
                _, _, remote, state, queues = row.split()[:5]
                if state == "01" and int(remote.split(":")[1], 16) == self.broker.port:
                    return int(queues.split(":")[1], 16)
        raise AssertionError("no connection")

    def test_it_waits_while_the_broker_is_there_hangs_and_is_gone(self):
        self.start_broker()
        self.start_plant(keep_alive_s=5)
        self.agent.wait_logged("broker_connected")
        self.assert_waits("nothing is said")
        with frozen(self.broker.process):
            self.assert_waits("the broker hangs")
            self.agent.wait_logged("broker_lost")
            self.assert_waits("the broker takes the next connection and says nothing")
        self.broker.kill()
        self.assert_waits("nobody listens")
        self.broker.start()
        self.agent.wait_logged("broker_connected", 2)
        self.assert_waits("nothing is said again")

    def test_it_waits_over_tls(self):
        self.start_broker(tls_conf(self.directory))
        self.start_plant(servers=[f"mqtts://127.0.0.1:{self.broker.port}"],
                         tls={"ca_file": os.path.join(self.directory, "ca.pem")})
        self.agent.wait_logged("broker_connected")
        self.assert_waits("nothing is said")
        self.broker_away()
        self.assert_waits("nobody listens")

    def test_it_waits_while_the_broker_refuses(self):
        def refuse(session, _):
            session.connack(0x87)
            session.close()
        self.broker = Scripted(Script(), Script(connect=refuse))
        self.start_plant()
        self.broker.wait_online(BASE).close()
        self.agent.wait_logged("Not authorized")
        self.assert_waits("the broker refuses")

    def test_it_waits_while_the_broker_talks_and_does_not_read(self):
        # poll() returns at once then: data is waiting, and Paho does not read before it can send.
        self.broker = Scripted()
        port = free_port()
        self.start_plant(
            [{"name": "meter1", "link": "net", "protocol": "modbus-tcp",
              "groups": [{"name": "flood", "interval_ms": 0}],
              "tags": [tag(f"{i:060}", f"hr:{i}", "flood", type="uint16") for i in range(500)]}],
            [{"name": "meter1", "protocol": "modbus-tcp", "tcp": port}],
            [tcp_link(port, "net")], qos=0)
        session = self.broker.wait_online(BASE)
        session.stop_reading()

        def stuck():
            session.send(packet(PINGRESP))
            self.wait_polls(5)
            return self.unread() > 0
        wait_for("something that is not read", stuck)
        self.assert_waits("the broker talks and does not read")
        self.assertGreater(self.unread(), 0)


if __name__ == "__main__":
    unittest.main(verbosity=2)
