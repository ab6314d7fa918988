// The gateway API of a ThingsBoard server, by aedes: node thingsboard.js PORT TOKEN. As ThingsBoard it knows the
// gateway by its access token, the user name, forwards nothing, and closes the connection after a message that it
// cannot read; it is stricter in that a device must be connected first. It prints each event as a line of JSON:
//   {"type": "ready"}    {"type": "session"}    {"type": "subscribed", "topic"}    {"type": "lost"}
//   {"type": "connect", "device": "press1", "profile"}    {"type": "disconnect", "device"}
//   {"type": "telemetry", "device", "rows": [{"ts", "values"}]}    {"type": "attributes", "device", "values"}
//   {"type": "answer", "device", "id", "data"}    {"type": "fault", "why"}
// A line {"rpc": {"device", "method", "params"}, "retain": true} on its standard input sends a request with the next
// id, from 0 on, and {"raw": "text"} a text instead. It ends with its standard input.
"use strict";
const net = require("net");
const aedes = require("aedes")();

const [port, token] = process.argv.slice(2);
const base = "v1/gateway/";
let gateway = null;
let nextId = 0;
const devices = new Set();  // connected
const pending = new Map();  // device by id

const print = (event) => process.stdout.write(JSON.stringify(event) + "\n");
const isObject = (value) => value !== null && typeof value === "object" && !Array.isArray(value);

function must(condition, why) {
  if (!condition) throw new Error(why);
}
function mustHave(object, required, optional = []) {
  must(isObject(object), "not an object");
  for (const key of required) must(key in object, `no ${key}`);
  for (const key of Object.keys(object)) must([...required, ...optional].includes(key), `unknown key ${key}`);
}
// A number, a string or a boolean; JSON where ThingsBoard keeps it. Never null.
function mustBeValues(values) {
  must(isObject(values) && Object.keys(values).length > 0, "no values");
  for (const [key, value] of Object.entries(values)) {
    must(key !== "", "an empty key");
    must(["number", "string", "boolean"].includes(typeof value) || isObject(value),
         `${key} is ${JSON.stringify(value)}`);
    must(typeof value !== "number" || !Number.isInteger(value) || Number.isSafeInteger(value), `${key} is not exact`);
  }
}
function mustBeConnected(device) {
  must(devices.has(device), `${device} is not connected`);
}

const readers = {
  connect(message) {
    mustHave(message, ["device"], ["type"]);
    must(typeof message.device === "string" && message.device !== "", "no device");
    must(typeof message.type === "string" && message.type !== "", "no device profile");
    must(!devices.has(message.device), `${message.device} is connected already`);
    devices.add(message.device);
    print({type: "connect", device: message.device, profile: message.type});
  },
  disconnect(message) {
    mustHave(message, ["device"]);
    mustBeConnected(message.device);
    devices.delete(message.device);
    print({type: "disconnect", device: message.device});
  },
  telemetry(message) {
    must(isObject(message) && Object.keys(message).length > 0, "no device");
    for (const [device, rows] of Object.entries(message)) {
      mustBeConnected(device);
      must(Array.isArray(rows) && rows.length > 0, "no rows");
      for (const row of rows) {
        mustHave(row, ["ts", "values"]);
        must(Number.isSafeInteger(row.ts) && row.ts > 1.6e12, `ts ${row.ts}`);
        mustBeValues(row.values);
        for (const value of Object.values(row.values)) must(typeof value !== "object", "JSON as telemetry");
      }
      print({type: "telemetry", device, rows});
    }
  },
  attributes(message) {
    must(isObject(message) && Object.keys(message).length > 0, "no device");
    for (const [device, values] of Object.entries(message)) {
      mustBeConnected(device);
      mustBeValues(values);
      print({type: "attributes", device, values});
    }
  },
  rpc(message) {
    mustHave(message, ["device", "id", "data"]);
    must(Number.isInteger(message.id), "an id that is not an integer");
    must(pending.has(message.id), `an answer to ${message.id}, which nobody asked or which has one`);
    must(pending.get(message.id) === message.device, "an answer of another device");
    pending.delete(message.id);
    print({type: "answer", device: message.device, id: message.id, data: message.data});
  },
};

aedes.authenticate = (client, username, password, done) => {
  if (username !== token) print({type: "fault", why: `user name ${username}`});
  // The first message may come before aedes calls the client ready.
  gateway = client;
  devices.clear();
  pending.clear();
  print({type: "session"});
  done(null, username === token);
};
aedes.authorizeSubscribe = (client, subscription, done) => done(null, subscription);
// Only what the server itself sends, which is a string here.
aedes.authorizeForward = (client, packet) => (typeof packet.payload === "string" ? packet : null);
aedes.authorizePublish = (client, packet, done) => {
  try {
    const kind = packet.topic.startsWith(base) ? packet.topic.slice(base.length) : "";
    must(Object.prototype.hasOwnProperty.call(readers, kind), `topic ${packet.topic}`);
    must(packet.qos === 1 && !packet.retain, "not QoS 1, or retained");
    must(packet.payload.length <= 65536, "above 64 KiB");
    readers[kind](JSON.parse(packet.payload.toString("utf8")));
    done(null);
  } catch (error) {
    print({type: "fault", why: error.message, topic: packet.topic,
           payload: packet.payload.toString("utf8").slice(0, 500)});
    done(error);
  }
};
aedes.on("clientReady", (client) => {
  if (client.will) print({type: "fault", why: "a last will"});
});
aedes.on("subscribe", (subscriptions) => subscriptions.forEach(({topic}) => print({type: "subscribed", topic})));
aedes.on("clientDisconnect", (client) => {
  if (client === gateway) gateway = null;
  print({type: "lost"});
});

net.createServer(aedes.handle).listen(Number(port), "127.0.0.1", () => print({type: "ready"}));

require("readline").createInterface({input: process.stdin}).on("line", (line) => {
  const order = JSON.parse(line);
  let payload = order.raw;
  if (order.rpc) {
    const {device, ...data} = order.rpc;
    pending.set(nextId, device);
    payload = JSON.stringify({device, data: {id: nextId, ...data}});
    nextId += 1;
  }
  gateway.publish({topic: base + "rpc", payload, qos: 1, retain: Boolean(order.retain)}, () => {});
}).on("close", () => process.exit(0));
