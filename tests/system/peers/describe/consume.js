// A consumer of the Web of Things, by Eclipse's node-wot: node consume.js THING DEVICE PROPERTY ACTION INPUT
// Knows the agent only from its Thing Description, the file THING. Reads the device's state, observes the property, and
// invokes the action with INPUT, JSON. Prints a line for each: "state ", "sample " and "result " with the JSON received.
"use strict";
const fs = require("fs");
const { Servient } = require("@node-wot/core");
const { MqttClientFactory } = require("@node-wot/binding-mqtt");

const [path, device, property, action, input] = process.argv.slice(2);
const print = async (what, output) => console.log(what + " " + JSON.stringify(await output.value()));

async function consume() {
  const servient = new Servient();
  servient.addClientFactory(new MqttClientFactory());
  const wot = await servient.start();
  const thing = await wot.consume(JSON.parse(fs.readFileSync(path, "utf-8")));
  await print("state", await thing.readProperty(device + "/state"));
  const sample = await new Promise((resolve) => thing.observeProperty(property, resolve));
  await print("sample", sample);
  const result = new Promise((resolve) => thing.subscribeEvent(device + "/result", resolve));
  await thing.invokeAction(action, JSON.parse(input));
  await print("result", await result);
}

consume().then(() => process.exit(0));
