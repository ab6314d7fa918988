"""A Modbus-to-MQTT bridge as users write it by hand: pymodbus and paho-mqtt, one thread per device.

    bridge.py '{"mqtt": 1883, "interval_ms": 100, "devices": [{"name": "d0", "port": 5020,
               "blocks": [[0, 125], [125, 125]]}]}'

Publishes every cycle as JSON on bridge/<name>/data. Carries out {"id", "address", "value"} from bridge/<name>/command
and answers on bridge/<name>/result. interval_ms 0: as fast as possible.
"""

import json
import sys
import threading
import time

import paho.mqtt.client as mqtt
from pymodbus.client import ModbusTcpClient


class Device(threading.Thread):
    def __init__(self, config, interval, client):
        super().__init__(daemon=True)
        self.name_ = config["name"]
        self.blocks = config["blocks"]
        self.interval = interval
        self.mqtt = client
        self.lock = threading.Lock()
        self.modbus = ModbusTcpClient("127.0.0.1", port=config["port"])

    def run(self):
        self.modbus.connect()
        due = time.monotonic()
        while True:
            values = []
            for address, count in self.blocks:
                with self.lock:
                    answer = self.modbus.read_holding_registers(address, count, 1)
                if answer.isError():
                    break
                values += answer.registers
            else:
                message = {"ts": int(time.time() * 1000),
                           "values": {f"r{i}": value for i, value in enumerate(values)}}
                self.mqtt.publish(f"bridge/{self.name_}/data", json.dumps(message), 1)
            if self.interval:
                due += self.interval
                time.sleep(max(0.0, due - time.monotonic()))

    def command(self, order):
        with self.lock:
            answer = self.modbus.write_register(order["address"], order["value"], 1)
        self.mqtt.publish(f"bridge/{self.name_}/result",
                          json.dumps({"id": order["id"], "ok": not answer.isError()}), 1)


def main():
    config = json.loads(sys.argv[1])
    client = mqtt.Client()
    client.max_inflight_messages_set(1000)
    devices = {d["name"]: Device(d, config["interval_ms"] / 1000, client)
               for d in config["devices"]}
    client.on_connect = lambda c, *_: c.subscribe("bridge/+/command", 1)
    client.on_message = lambda _c, _u, m: devices[m.topic.split("/")[1]].command(
        json.loads(m.payload))
    client.connect("127.0.0.1", config["mqtt"])
    client.loop_start()
    for device in devices.values():
        device.start()
    threading.Event().wait()


main()
