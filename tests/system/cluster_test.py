"""Agents on a real cluster of three RabbitMQ nodes: a node is killed, and another one goes silent. Longer, with more
agents and faults: cluster_chaos.py."""

import os
import shutil
import sys
import tempfile
import unittest

import rabbit_cluster
from cluster_plant import ClusterPlant
from plant import has_failed, read_text, text_of, wait_for

AGENTS = 4
# Seconds. On a busy machine RabbitMQ closes connections with a shorter one.
KEEP_ALIVE = 5
LIMIT_S = 120


@unittest.skipUnless(rabbit_cluster.available(), "needs the package rabbitmq-server")
class Cluster(unittest.TestCase):
    def setUp(self):
        self.directory = tempfile.mkdtemp(prefix="fxagent-test-")
        self.addCleanup(shutil.rmtree, self.directory, ignore_errors=True)
        self.addCleanup(self.show)
        self.cluster = rabbit_cluster.RabbitCluster(self.directory)
        self.addCleanup(self.cluster.close)
        self.cluster.start()

    def show(self):
        """Prints the logs of a test that failed."""
        if not has_failed(self):
            return
        for node in self.cluster.nodes:
            print(f"---- {node.name}:\n{node.logged()[-8_000:]}", file=sys.stderr)
        for number in range(AGENTS):
            path = os.path.join(self.directory, f"a{number}", "agent.log")
            print(f"---- agent a{number}:\n{text_of(path)[-8_000:]}", file=sys.stderr)

    def moved(self, plant, names, node):
        """Waits until these agents are connected to nodes other than `node`."""
        wait_for(f"{names} to leave node {node.number}",
                 lambda: all(plant.node_of(name) not in (None, node) for name in names), LIMIT_S)

    def more_samples(self, plant, names):
        """Waits for a sample of each agent that was made after this call."""
        newest = {name: max(plant.observer.seqs[name]) for name in names}
        try:
            wait_for("new samples", lambda: all(max(plant.observer.seqs[name]) > newest[name] + 2 for name in names), LIMIT_S)
        except AssertionError as error:
            got = {name: max(plant.observer.seqs[name]) - newest[name] for name in names}
            self.fail(f"{error}: {got}, observer lost {plant.observer.losses}: {plant.observer.why}")

    def more_results(self, plant):
        sent = len(plant.commander.sent)
        wait_for("results of new commands", lambda: all(
            plant.observer.own(*key) for key in list(plant.commander.sent)[:sent + AGENTS])
            and len(plant.commander.sent) >= sent + AGENTS, LIMIT_S)

    def test_no_sample_and_no_command_is_lost_with_a_node(self):
        first, second, third = self.cluster.nodes
        wait_for("node 2 to find nothing", lambda: "rabbitmq-rejoin" not in second.rejoin(), LIMIT_S)
        with ClusterPlant(self.directory, self.cluster, AGENTS, interval_ms=500, per_second=5,
                          keep_alive=KEEP_ALIVE) as plant:
            self.more_results(plant)
            names = plant.on_node(first)
            self.assertIn("a0", names, "it begins with the first of its servers")
            first.kill()
            self.moved(plant, names, first)
            self.assertIn("rabbitmq-rejoin: no answer", first.rejoin())
            self.more_samples(plant, plant.names)
            self.more_results(plant)
            # Without the dead node: its return takes up to 35 s. The clients of the second one receive nothing more.
            names = plant.on_node(second)
            self.assertNotEqual(names, [])
            second.proxy.cut_off()
            self.moved(plant, names, second)
            self.more_samples(plant, plant.names)
            self.more_results(plant)
            self.assertEqual(plant.on_node(third), plant.names)
            plant.settle()
            self.assertEqual(plant.faults(), [])


class ClusterPage(unittest.TestCase):
    def test_the_page_shows_the_config_that_is_tested(self):
        page = read_text(rabbit_cluster.PAGE)
        for line in rabbit_cluster.CONFIG.splitlines():
            if not line.startswith("#") and "{" not in line:
                self.assertIn("\n" + line + "\n", page)
        self.assertIn(f"OnUnitInactiveSec={rabbit_cluster.REJOIN_S:.0f}s\nAccuracySec=1s\n", page)
        self.assertIn("systemctl restart --no-block rabbitmq-server", rabbit_cluster.rejoin_script())
        _, name, pattern, definition, *_ = rabbit_cluster.POLICY
        self.assertIn(f"rabbitmqctl set_policy {name} '{pattern}' \\\n  '{definition}' --apply-to queues\n", page)


if __name__ == "__main__":
    unittest.main()
