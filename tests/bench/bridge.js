// A Modbus-to-MQTT bridge as users write it by hand: modbus-serial and mqtt.js. Same arguments, topics
// and payloads as bridge.py.
"use strict";
const ModbusRTU = require("modbus-serial");
const mqtt = require("mqtt");

const config = JSON.parse(process.argv[2]);
const client = mqtt.connect(`mqtt://127.0.0.1:${config.mqtt}`);
const devices = new Map();

async function poll(device) {
  await device.modbus.connectTCP("127.0.0.1", { port: device.port });
  device.modbus.setID(1);
  device.modbus.setTimeout(1000);
  let due = performance.now();
  for (;;) {
    try {
      const values = {};
      let index = 0;
      for (const [address, count] of device.blocks) {
        while (device.orders.length > 0) await carryOut(device, device.orders.shift());
        const answer = await device.modbus.readHoldingRegisters(address, count);
        for (const value of answer.data) values["r" + index++] = value;
      }
      client.publish(`bridge/${device.name}/data`, JSON.stringify({ ts: Date.now(), values }),
                     { qos: 1 });
    } catch (error) {
      console.error(device.name, error.message);
    }
    if (config.interval_ms > 0) {
      due += config.interval_ms;
      for (let rest = due - performance.now(); rest > 0; rest = due - performance.now()) {
        await new Promise((wake) => { device.wake = wake; setTimeout(wake, rest); });
        while (device.orders.length > 0) await carryOut(device, device.orders.shift());
      }
    }
  }
}

async function carryOut(device, order) {
  let ok = true;
  try {
    await device.modbus.writeRegister(order.address, order.value);
  } catch (error) {
    ok = false;
  }
  client.publish(`bridge/${device.name}/result`, JSON.stringify({ id: order.id, ok }), { qos: 1 });
}

client.on("connect", () => {
  client.subscribe("bridge/+/command", { qos: 1 });
  for (const d of config.devices) {
    const device = { ...d, modbus: new ModbusRTU(), orders: [], wake: null };
    devices.set(d.name, device);
    poll(device);
  }
});
client.on("message", (topic, payload) => {
  const device = devices.get(topic.split("/")[1]);
  device.orders.push(JSON.parse(payload));
  if (device.wake) device.wake();
});
