// Validates what `fxagent describe` prints, and messages against it, with other people's validators:
//   node validate.js schema DOCUMENT MESSAGES [strict]   ajv, draft 2020-12
//   node validate.js asyncapi DOCUMENT MESSAGES          @asyncapi/parser, and ajv with the schemas of its channels
//   node validate.js wot DOCUMENT MESSAGES               the JSON Schema of Thing Descriptions, @node-wot/td-tools,
//                                                        and ajv with the schemas of its affordances
// DOCUMENT and MESSAGES are JSON files. MESSAGES is an array of [topic, payload]. With `strict`, a payload must not
// have keys that its schema does not name. Prints JSON: {"document": [errors], "messages": [[errors] of each]}. A
// message is validated by each schema for its topic; without any, its errors are ["no schema"].
"use strict";
const fs = require("fs");
const Ajv = require("ajv");
const Ajv2020 = require("ajv/dist/2020");
const addFormats = require("ajv-formats");

const [kind, documentPath, messagesPath, strict] = process.argv.slice(2);
const text = fs.readFileSync(documentPath, "utf-8");
const messages = JSON.parse(fs.readFileSync(messagesPath, "utf-8"));
const told = (errors) => (errors || []).map((e) => `${e.instancePath} ${e.message} (${e.schemaPath})`);

// Makes every object of the schema refuse keys that it does not name.
function closed(schema) {
  if (schema === null || typeof schema !== "object") return schema;
  if (Array.isArray(schema)) return schema.map(closed);
  const out = Object.fromEntries(Object.entries(schema).map(([key, part]) => [key, closed(part)]));
  if (out.type === "object" && out.properties && typeof out.properties === "object" && !("additionalProperties" in out))
    out.additionalProperties = false;
  return out;
}

// Returns the messages' errors. `schemasFor` returns the schemas of a topic.
function judged(ajv, schemasFor) {
  const compiled = new Map();
  const check = (schema) => {
    if (!compiled.has(schema)) compiled.set(schema, ajv.compile(schema));
    return compiled.get(schema);
  };
  return messages.map(([topic, payload]) => {
    const schemas = schemasFor(topic);
    if (schemas.length === 0) return ["no schema"];
    return schemas.flatMap((schema) => (check(schema)(payload) ? [] : told(check(schema).errors)));
  });
}

function judgeSchema() {
  let document = JSON.parse(text);
  if (strict) document = closed(document);
  const ajv = addFormats(new Ajv2020({ allErrors: true, strict: true, strictTypes: false, strictRequired: false }));
  if (!ajv.validateSchema(document)) return { document: told(ajv.errors), messages: [] };
  const whole = ajv.compile(document);
  return {
    document: [],
    messages: messages.map(([topic, payload]) => (whole({ [topic]: payload }) ? [] : told(whole.errors))),
  };
}

async function judgeAsyncapi() {
  const { Parser } = require("@asyncapi/parser");
  const { document, diagnostics } = await new Parser().parse(text);
  const wrong = diagnostics.filter((d) => d.severity <= 1).map((d) => `${d.path.join("/")} ${d.message}`);
  if (!document) return { document: wrong, messages: [] };
  const matches = (channel, topic) => {
    const names = (_, name) => `(${channel.parameters().get(name).json().enum.join("|")})`;
    return new RegExp("^" + channel.address().replace(/\{([a-z]+)\}/g, names) + "$").test(topic);
  };
  // One validator with all schemas, because the parser leaves references that form a circle.
  const schemas = JSON.parse(text).components.schemas;
  const ajv = new Ajv({ allErrors: true, strict: false });
  ajv.addSchema({ components: { schemas } }, "all");
  const references = new Map();
  const reference = (name) => {
    if (!references.has(name)) references.set(name, { $ref: `all#/components/schemas/${name}` });
    return references.get(name);
  };
  return {
    document: wrong,
    messages: judged(ajv, (topic) =>
      document.channels().all().filter((c) => matches(c, topic))
        .flatMap((c) => c.messages().all().map((m) => reference(m.name())))),
  };
}

function judgeThing() {
  const { parseTD } = require("@node-wot/td-tools");
  const thing = JSON.parse(text);
  const rules = JSON.parse(
    fs.readFileSync(require.resolve("wot-thing-description-types/schema/td-json-schema-validation.json"), "utf-8"));
  const ajv = addFormats(new Ajv({ allErrors: true, strict: false }));
  const isThing = ajv.compile(rules);
  if (!isThing(thing)) return { document: told(isThing.errors), messages: [] };
  const parsed = parseTD(text);
  // The affordances of each topic.
  const byTopic = new Map();
  const add = (affordance, schema) => {
    for (const form of affordance.forms) {
      const topic = form["mqv:filter"] || form["mqv:topic"];
      if (!byTopic.has(topic)) byTopic.set(topic, []);
      byTopic.get(topic).push(schema);
    }
  };
  for (const property of Object.values(parsed.properties)) add(property, property);
  for (const event of Object.values(parsed.events)) add(event, event.data);
  const actions = new Map();
  for (const action of Object.values(parsed.actions))
    for (const form of action.forms) {
      const topic = form["mqv:topic"];
      actions.set(topic, [...(actions.get(topic) || []), action.input]);
    }
  for (const [topic, inputs] of actions) byTopic.set(topic, [{ anyOf: inputs }]);
  const values = new Ajv({ allErrors: true, strict: false });
  return { document: [], messages: judged(values, (topic) => [...new Set(byTopic.get(topic) || [])]) };
}

const judges = { schema: judgeSchema, asyncapi: judgeAsyncapi, wot: judgeThing };
Promise.resolve(judges[kind]()).then((result) => console.log(JSON.stringify(result)));
