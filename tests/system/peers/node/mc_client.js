// An MC protocol client by mcprotocol, over TCP: node mc_client.js PORT FRAME CODE read ITEM... or
// ... write ITEM VALUE, where FRAME is 1E or 3E, CODE binary or ascii, an item its way to name it ("D100,5",
// "M0,16", "X17") and VALUE JSON. Prints "result " and JSON: of a read the values by item, of a write whether it
// thinks that it failed.
"use strict";
const MCProtocol = require("mcprotocol");

const [port, frame, code, verb, ...words] = process.argv.slice(2);
const end = (result) => {
  console.log("result " + JSON.stringify(result));
  process.exit(0);
};
const fail = (why) => {
  console.log("failed " + why);
  process.exit(1);
};
const client = new MCProtocol();
client.initiateConnection({ port: Number(port), host: "127.0.0.1", frame, ascii: code === "ascii" }, (error) => {
  if (error !== undefined) return fail(error);
  client.setTranslationCB((item) => item);
  if (verb === "write")
    return client.writeItems(words[0], JSON.parse(words[1]), (bad) => end({ bad }));
  client.addItems(words);
  client.readAllItems((bad, values) => (bad ? fail("bad values " + JSON.stringify(values)) : end(values)));
});
