// A Modbus TCP server by jsmodbus: node server.js PORT. Unit 1 with the same values as
// pymodbus_server.py. Prints "ready" when it serves.
"use strict";
const net = require("net");
const modbus = require("jsmodbus");

const registers = (first) => {
  const bytes = Buffer.alloc(200);
  for (let n = 0; n < 100; n++) bytes.writeUInt16BE(first + n, 2 * n);
  return bytes;
};
const bits = (every) => {
  const bytes = Buffer.alloc(13);
  for (let n = 0; n < 100; n += every) bytes[n >> 3] |= 1 << (n & 7);
  return bytes;
};
const socket = new net.Server();
new modbus.server.TCP(socket, {
  holding: registers(1000), input: registers(2000), coils: bits(3), discrete: bits(5)
});
socket.listen(Number(process.argv[2]), "127.0.0.1", () => console.log("ready"));
