// An MQTT broker by aedes: node mqtt_broker.js PORT. Prints "ready" when it serves.
"use strict";
const net = require("net");
const aedes = require("aedes")();

net.createServer(aedes.handle).listen(Number(process.argv[2]), "127.0.0.1", () => console.log("ready"));
