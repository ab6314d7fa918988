// A host of Sparkplug C for one edge node, by protobufjs and mqtt.js: node sparkplug_c_host.js PORT GROUP NODE. It keeps the
// rules of typed commands for the node's messages, and prints each message as a line of JSON:
//   {"type": "DBIRTH", "device": "press1", "seq": 1, "commands": {"Write/setpoint": {"arguments": [{"name", "type"}],
//    "results": […]}}, "faults": ["what breaks a rule"]}
//   {"type": "DRESP", "device": "press1", "name", "id", "code", "message", "results": {"value": 5}, "faults": []}
// A line {"command": {"device", "name", "id", "arguments": [{"name", "type", "value"}], "source"}} on its standard input sends
// an NCMD or DCMD, {"rebirth": true} a REBIRTH, {"state": true or false, "host", "timestamp"} publishes its own state. It ends
// with its standard input. The numbers are those of Eclipse Tahu's sparkplug_c.proto.
"use strict";
const mqtt = require("mqtt");
const protobuf = require("protobufjs");

const field = (id, type, rule) => (rule ? {id, type, rule} : {id, type});
const Payload = protobuf.Root.fromJSON({nested: {
  Payload: {fields: {timestamp: field(1, "uint64"), metrics: field(2, "Metric", "repeated"), seq: field(3, "uint64"),
                     bdSeq: field(4, "uint64"), source: field(5, "string"), uuid: field(6, "string"), body: field(7, "bytes")}},
  Metric: {fields: {name: field(1, "string"), alias: field(2, "uint64"), timestamp: field(3, "uint64"),
                    datatype: field(4, "uint32"), source: field(5, "string"), isHistorical: field(6, "bool"),
                    isTransient: field(7, "bool"), isNull: field(8, "bool"), properties: field(10, "PropertySet"),
                    value: field(11, "TypedValue"), command: field(12, "Command")}},
  Command: {fields: {arguments: field(1, "Metric", "repeated"), results: field(2, "Metric", "repeated"),
                     correlationId: field(3, "string"), status: field(4, "Status")}},
  Status: {fields: {code: field(1, "uint64"), message: field(2, "string")}},
  PropertySet: {fields: {keys: field(1, "string", "repeated"), values: field(2, "TypedValue", "repeated")}},
  TypedValue: {
    oneofs: {value: {oneof: ["int32", "int64", "uint32", "uint64", "float", "double", "boolean", "string", "bytes"]}},
    fields: {datatype: field(1, "uint32"), isNull: field(2, "bool"), int32: field(3, "int32"), int64: field(4, "int64"),
             uint32: field(5, "uint32"), uint64: field(6, "uint64"), float: field(7, "float"), double: field(8, "double"),
             boolean: field(9, "bool"), string: field(10, "string"), bytes: field(11, "bytes")}},
}}).lookupType("Payload");

const kCommand = 35;
// Data types: their number and the field of their values.
const types = {Int16: [2, "int32"], Int32: [3, "int32"], Int64: [4, "int64"], UInt16: [6, "uint32"], UInt32: [7, "uint32"],
               UInt64: [8, "uint64"], Float: [9, "float"], Double: [10, "double"], Boolean: [11, "boolean"],
               String: [12, "string"], Int16Array: [23, "bytes"], BooleanArray: [32, "bytes"]};
const nameOf = (number) => Object.keys(types).find((name) => types[name][0] === number) || number;

const [port, group, node] = process.argv.slice(2);
const base = `spCv1.0/${group}`;
const asked = new Set();  // correlation ids without an answer
let session = null;       // {bdSeq, seq, devices: {name: commands}}

const print = (event) => process.stdout.write(JSON.stringify(event) + "\n");
const has = (object, key) => Object.prototype.hasOwnProperty.call(object, key);
const number = (value) => (value === undefined ? null : Number(value));

function valueOf(value, faults) {
  const key = Object.keys(value).find((each) => !["datatype", "isNull"].includes(each));
  if (value.isNull) return null;
  const expected = (types[nameOf(value.datatype)] || [])[1];
  if (key !== expected) faults.push(`a ${nameOf(value.datatype)} in the field ${key}`);
  if (key === "bytes") return Array.from(Buffer.from(value.bytes, "base64"));
  return typeof value[key] === "string" && key !== "string" ? Number(value[key]) : value[key];
}

function definitions(metrics, faults) {
  const found = {};
  for (const metric of metrics) {
    if (metric.datatype !== kCommand || !metric.command) faults.push(`${metric.name} is not a command`);
    const side = (list) => (list || []).map((each) => {
      if (!each.name || !types[nameOf(each.datatype)]) faults.push(`${metric.name}: a part without name or data type`);
      if (each.value) faults.push(`${metric.name}: a definition with a value`);
      const set = each.properties || {keys: [], values: []};
      return {name: each.name, type: nameOf(each.datatype),
              ...Object.fromEntries(set.keys.map((key, i) => [key, valueOf(set.values[i], faults)]))};
    });
    if (has(found, metric.name)) faults.push(`${metric.name} twice`);
    found[metric.name] = {arguments: side((metric.command || {}).arguments), results: side((metric.command || {}).results)};
  }
  return found;
}

function judgeBirth(type, device, payload, faults) {
  const seq = payload.seq === undefined ? null : BigInt(payload.seq);
  const bdSeq = number(payload.bdSeq);
  if (type === "NDEATH") {
    if (Object.keys(payload).join() !== "bdSeq") faults.push("NDEATH with more than bd_seq");
    if (session && session.bdSeq === bdSeq) session = null;
    return {bdSeq};
  }
  if (!has(payload, "timestamp")) faults.push("no timestamp in the payload");
  if (seq === null) faults.push("no seq");
  if (type === "NBIRTH") {
    if (seq !== 0n) faults.push("NBIRTH with a seq other than 0");
    if (bdSeq === null) faults.push("NBIRTH without bd_seq");
    session = {bdSeq, seq, devices: {}};
  } else if (!session) {
    faults.push(`${type} without NBIRTH`);
    return {};
  } else if (type.endsWith("REBIRTH")) {
    // Repeats numbers: the last of the sequence is the last that was used.
    if (type === "NREBIRTH" && bdSeq !== session.bdSeq) faults.push(`bd_seq ${bdSeq} in the session ${session.bdSeq}`);
    if (type === "NREBIRTH") session.again = seq;
    else if (seq !== (session.again = BigInt.asUintN(64, session.again + 1n))) faults.push(`seq ${seq} in a rebirth`);
    if (seq > session.seq) faults.push("a rebirth with a number that was not used yet");
    if (type === "DREBIRTH" && !has(session.devices, device)) faults.push(`DREBIRTH of ${device} without DBIRTH`);
  } else {
    if (has(session, "again") && session.again !== session.seq) faults.push(`a rebirth ended with the number ${session.again}`);
    delete session.again;
    session.seq = BigInt.asUintN(64, session.seq + 1n);
    if (seq !== session.seq) faults.push(`seq ${seq} where ${session.seq} was due`);
    session.seq = seq;
  }
  if (type.startsWith("N")) return {bdSeq, seq: number(payload.seq)};
  if (type === "DDEATH") {
    if (!has(session.devices, device)) faults.push(`DDEATH of ${device} without DBIRTH`);
    delete session.devices[device];
    return {seq: number(payload.seq)};
  }
  return {seq: number(payload.seq), commands: (session.devices[device] = definitions(payload.metrics || [], faults))};
}

function judgeAnswer(type, device, payload, faults) {
  const [metric] = payload.metrics || [{}];
  const command = metric.command || {};
  const status = command.status || {};
  if (!has(payload, "timestamp")) faults.push("no timestamp in the payload");
  if ((payload.metrics || []).length !== 1 || metric.datatype !== kCommand) faults.push("not exactly one command");
  if (!has(status, "code")) faults.push("no status");
  const id = command.correlationId || "";
  if (!asked.delete(id)) faults.push(`nobody asked for ${id}, or it was answered`);
  if (!session) faults.push(`${type} without NBIRTH`);
  const results = {};
  for (const each of command.results || []) results[each.name] = valueOf(each.value || {}, faults);
  const known = session && session.devices[device] && session.devices[device][metric.name];
  if (known && number(status.code) === 0)
    for (const each of known.results)
      if (!has(results, each.name)) faults.push(`success without the result ${each.name}`);
  return {name: metric.name, id, code: number(status.code), message: status.message, results};
}

const client = mqtt.connect(`mqtt://127.0.0.1:${port}`, {protocolVersion: 5, reconnectPeriod: 200, clientId: "host-c"});
client.on("connect", () => client.subscribe(`${base}/+/${node}/#`, {qos: 1, rap: true}, () => print({type: "ready"})));
client.on("error", () => {});
client.on("message", (topic, bytes, packet) => {
  const [, , type, , device] = topic.split("/");
  if (["NCMD", "DCMD", "REBIRTH"].includes(type)) return;
  const faults = [];
  if (packet.retain) faults.push("retained");
  if (type !== "NDEATH" && packet.qos !== 0) faults.push(`QoS ${packet.qos}`);
  const payload = Payload.toObject(Payload.decode(bytes), {longs: String, bytes: String});
  const judge = type.endsWith("RESP") ? judgeAnswer : judgeBirth;
  print({type, device: device || null, ...judge(type, device, payload, faults), faults});
});

const now = () => String(BigInt(Date.now()) * 1000000n);
function send(verb, device, payload, retain) {
  const bytes = Payload.encode(Payload.fromObject({timestamp: now(), ...payload})).finish();
  client.publish(`${base}/${verb}/${node}` + (device ? `/${device}` : ""), Buffer.from(bytes), {qos: 0, retain});
}

require("readline").createInterface({input: process.stdin}).on("line", (line) => {
  const order = JSON.parse(line);
  if (order.command) {
    const {device, name, id, source, retain} = order.command;
    const given = (order.command.arguments || []).map(({name: key, type, value}) => (type === null ? {name: key} : {
      name: key, datatype: types[type][0], value: {datatype: types[type][0],
        [types[type][1]]: types[type][1] === "bytes" ? Buffer.from(value) : value}}));
    asked.add(id || "");
    send(device ? "DCMD" : "NCMD", device, {source: source === undefined ? "scada" : source, metrics: [
      {name, datatype: kCommand, command: {arguments: given, correlationId: id}}]}, retain);
  }
  if (order.rebirth) send("REBIRTH", null, {source: "scada"});
  if ("state" in order)
    client.publish(`spCv1.0/STATE/${order.host}`, `{"online": ${order.state}, "timestamp": ${order.timestamp}}`,
                   {qos: 1, retain: true});
}).on("close", () => process.exit(0));
