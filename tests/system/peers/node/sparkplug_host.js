// A Sparkplug host for one edge node, by sparkplug-payload and mqtt.js: node sparkplug_host.js PORT GROUP NODE [late]. It
// keeps the rules of Sparkplug 3.0 for the node's messages, and prints each message as a line of JSON:
//   {"type": "DDATA", "device": "press1", "seq": 7, "metrics": [{"name", "value", "ts", "historical", "quality", "why"}],
//    "faults": ["what breaks a rule"]}
// A line {"rebirth": "DEVICE or NODE"} on its standard input asks for a rebirth, {"write": {"device", "name" or "alias",
// "value"}} sends a DCMD, {"state": true or false} publishes its own state. It ends with its standard input.
// If it joins a session, because it is "late" or was disconnected, it asks for a rebirth and judges nothing until then.
"use strict";
const mqtt = require("mqtt");
const {get} = require("sparkplug-payload");
const proto = require("sparkplug-payload/lib/sparkplugPayloadProto").org.eclipse.tahu.protobuf.Payload;
const codec = get("spBv1.0");

const [port, group, node] = process.argv.slice(2);
const base = `spBv1.0/${group}`;
const numbers = {Int16: 2, Int32: 3, Int64: 4, UInt16: 6, UInt32: 7, UInt64: 8, Float: 9, Double: 10, Boolean: 11,
                 String: 12};
let session = null;  // {bdSeq, seq, devices: {name: {alias: {name, type}}}, aliases}
let lastBdSeq = null;
let joins = process.argv[5] === "late";
let askedAt = 0;

const print = (event) => process.stdout.write(JSON.stringify(event) + "\n");
const has = (object, key) => Object.prototype.hasOwnProperty.call(object, key);
const plain = (value) => (value && typeof value.toNumber === "function" ? value.toNumber() : value);

// The elements of an array type, which sparkplug-payload does not read.
function elements(type, bytes) {
  const data = Buffer.from(bytes);
  const numeric = {23: ["readInt16LE", 2], 24: ["readInt32LE", 4], 25: ["readBigInt64LE", 8], 27: ["readUInt16LE", 2],
                   28: ["readUInt32LE", 4], 29: ["readBigUInt64LE", 8], 30: ["readFloatLE", 4], 31: ["readDoubleLE", 8]};
  if (type === 32) {
    const count = data.readUInt32LE(0);
    return Array.from({length: count}, (_, i) => Boolean(data[4 + (i >> 3)] & (0x80 >> (i & 7))));
  }
  if (type === 33) return data.toString("utf8").split("\0").slice(0, -1);
  const [read, size] = numeric[type];
  return Array.from({length: data.length / size}, (_, i) => Number(data[read](i * size)));
}

function valueOf(metric, type) {
  if (metric.isNull) return null;
  if (type >= 22) return elements(type, metric.bytesValue);
  // sparkplug-payload reads a value by its data type, which only births have.
  const bytes = proto.encode({metrics: [Object.assign({}, metric, {name: "x", datatype: type})]}).finish();
  return plain(codec.decodePayload(bytes).metrics[0].value);
}

function properties(metric) {
  const found = {};
  if (!metric.properties) return found;
  metric.properties.keys.forEach((key, i) => {
    const value = metric.properties.values[i];
    for (const field of ["intValue", "doubleValue", "booleanValue", "stringValue"])
      if (has(value, field)) found[key] = value[field];
  });
  return found;
}

function readMetric(metric, known, isBirth, faults) {
  const entry = isBirth ? {name: metric.name, type: metric.datatype} : known[plain(metric.alias)];
  if (!has(metric, "timestamp")) faults.push(`no timestamp: ${metric.name || metric.alias}`);
  if (isBirth && (!metric.name || !metric.datatype)) faults.push("a birth without name or data type");
  if (!isBirth && (has(metric, "name") || has(metric, "datatype"))) faults.push("data with a name or a data type");
  if (!entry) {
    faults.push(`unknown alias ${metric.alias}`);
    return null;
  }
  const more = properties(metric);
  if (has(more, "quality") && ![0, 192, 500].includes(more.quality)) faults.push(`quality ${more.quality}`);
  return {name: entry.name, type: entry.type, ts: plain(metric.timestamp), historical: Boolean(metric.isHistorical),
          value: valueOf(metric, entry.type), ...more, alias: has(metric, "alias") ? plain(metric.alias) : undefined};
}

function readBirth(metrics, faults) {
  const known = {};
  let newest = 0;
  for (const metric of metrics) {
    if (plain(metric.timestamp) < newest) faults.push("metrics are not in the order of their time");
    newest = plain(metric.timestamp);
    if (!has(metric, "alias")) continue;
    const alias = plain(metric.alias);
    if (has(known, alias)) faults.push(`alias ${alias} twice`);
    known[alias] = {name: metric.name, type: metric.datatype};
  }
  return known;
}

// True if the message belongs to a session whose births this host has missed.
function misses(type) {
  if (type === "NBIRTH") joins = false;
  if (!joins || session || type === "NDEATH") return false;
  if (Date.now() > askedAt + 1000) {
    askedAt = Date.now();
    command("NCMD", null, [{name: "Node Control/Rebirth", datatype: 11, booleanValue: true}]);
  }
  return true;
}

function judge(type, device, payload, packet) {
  const faults = [];
  const metrics = payload.metrics || [];
  if (packet.retain) faults.push("retained");
  if (type !== "NDEATH" && packet.qos !== 0) faults.push(`QoS ${packet.qos}`);
  if (!has(payload, "timestamp")) faults.push("no timestamp in the payload");
  if ((type === "NDEATH") === has(payload, "seq")) faults.push("seq is missing, or in an NDEATH");
  const bdSeq = metrics.filter((metric) => metric.name === "bdSeq").map((metric) => plain(metric.longValue))[0];
  let known = {};
  if (type === "NBIRTH") {
    if (plain(payload.seq) !== 0) faults.push("NBIRTH with a seq other than 0");
    if (bdSeq === undefined) faults.push("NBIRTH without bdSeq");
    if (!metrics.some((metric) => metric.name === "bdSeq" && metric.datatype === numbers.Int64))
      faults.push("bdSeq is not an Int64");
    if (!metrics.some((metric) => metric.name === "Node Control/Rebirth" && metric.datatype === numbers.Boolean &&
                      metric.booleanValue === false && !has(metric, "alias")))
      faults.push("NBIRTH without Node Control/Rebirth = false, or that with an alias");
    const again = session && session.bdSeq === bdSeq;
    if (!again && lastBdSeq !== null && bdSeq !== (lastBdSeq + 1) % 256 && bdSeq !== 0)
      faults.push(`bdSeq ${bdSeq} after ${lastBdSeq}`);
    lastBdSeq = bdSeq;
    session = {bdSeq, seq: 0, devices: {}, ended: false, data: false};
    readBirth(metrics, faults);
  } else if (type === "NDEATH") {
    if (metrics.length !== 1 || bdSeq === undefined) faults.push("NDEATH without exactly bdSeq");
    if (session && bdSeq === session.bdSeq) session = null;
  } else if (!session) {
    faults.push(`${type} without NBIRTH`);
  } else {
    session.seq = (session.seq + 1) % 256;
    if (plain(payload.seq) !== session.seq) faults.push(`seq ${plain(payload.seq)} where ${session.seq} was due`);
    session.seq = plain(payload.seq);
    known = session.devices[device];
    if (type === "DBIRTH") {
      known = readBirth(metrics, faults);
      for (const [name, other] of Object.entries(session.devices))
        for (const alias of Object.keys(known))
          if (name !== device && has(other, alias)) faults.push(`alias ${alias} of ${name} and ${device}`);
      session.devices[device] = known;
    } else if (!known) {
      faults.push(`${type} of ${device} without DBIRTH`);
    } else if (type === "DDEATH") {
      delete session.devices[device];
    }
  }
  const isBirth = type.endsWith("BIRTH") || type === "NDEATH";
  print({type, device, seq: has(payload, "seq") ? plain(payload.seq) : null, bdSeq,
         metrics: metrics.map((metric) => readMetric(metric, known || {}, isBirth, faults)).filter(Boolean), faults});
}

const client = mqtt.connect(`mqtt://127.0.0.1:${port}`, {protocolVersion: 5, reconnectPeriod: 200, clientId: "host"});
const command = (kind, device, metrics) => client.publish(
  `${base}/${kind}/${node}` + (device ? `/${device}` : ""),
  Buffer.from(proto.encode({timestamp: Date.now(), metrics}).finish()), {qos: 1});
client.on("connect", () => client.subscribe(`${base}/+/${node}/#`, {qos: 1, rap: true}, () => print({type: "ready"})));
client.on("close", () => {
  session = null;
  joins = true;
});
client.on("error", () => {});
client.on("message", (topic, payload, packet) => {
  const [, , type, , device] = topic.split("/");
  if (!["NBIRTH", "NDEATH", "DBIRTH", "DDEATH", "DDATA", "NDATA"].includes(type)) return;
  if (misses(type)) return print({type: "missed"});
  judge(type, device || null, proto.toObject(proto.decode(payload)), packet);
});

require("readline").createInterface({input: process.stdin}).on("line", (line) => {
  const order = JSON.parse(line);
  if (order.rebirth === node)
    command("NCMD", null, [{name: "Node Control/Rebirth", datatype: 11, booleanValue: true}]);
  else if (order.rebirth)
    command("DCMD", order.rebirth, [{name: "Device Control/Rebirth", datatype: 11, booleanValue: true}]);
  if (order.write) {
    const {device, name, alias, value, type} = order.write;
    const field = {[numbers.Boolean]: "booleanValue", [numbers.String]: "stringValue", [numbers.Double]: "doubleValue",
                   [numbers.Float]: "floatValue"}[numbers[type]] || "intValue";
    command("DCMD", device, [{name, alias, timestamp: Date.now(), [field]: value}]);
  }
  if ("state" in order)
    client.publish(`spBv1.0/STATE/${order.host}`, JSON.stringify({online: order.state, timestamp: order.timestamp}),
                   {qos: 1, retain: true});
}).on("close", () => process.exit(0));
