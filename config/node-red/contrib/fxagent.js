// The nodes of fxagent for Node-RED 4: `fxagent-agent` knows the agents of a broker, `fxagent in` sends their values
// and states into a flow, `fxagent command` sends commands to them. Topics and payloads: docs/interface.md.
// The connection is that of an mqtt-broker node, so address, TLS and password are entered once.
"use strict";

const crypto = require("node:crypto");
const {Order} = require("./lib/order.js");
const {commandOf, wireOf, textOf, SUCCEEDED, NOT_CARRIED_OUT, UNKNOWN} = require("./lib/command.js");

const MARGIN_S = 5;           // after a command's expiry, for its last exchanges and for the way of its result
const MAX_SECONDS = 604800;   // the longest max_expiry_s
const MAX_UNANSWERED = 1000;  // ids of commands without a result, kept to report a late one

module.exports = function (RED) {
    // --- fxagent-agent: a broker and a root topic.

    function AgentNode(config) {
        RED.nodes.createNode(this, config);
        const node = this;
        const broker = RED.nodes.getNode(config.broker);
        node.root = (config.root || "fx").replace(/\/+$/, "");
        node.agents = new Map();  // id → {state, devices: name → {state, meta}}
        const members = new Set();
        const wanted = new Map();  // filter → number of members that need it
        const subscribed = new Set();
        let closed = false;
        let connected = false;

        const each = (call) => { for (const member of members) call(member); };
        node.isConnected = () => Boolean(broker && broker.connected);
        node.publish = (topic, payload, more, done) =>
            broker.publish({...more, topic, payload, qos: 1, retain: false}, done);

        /** Adds a node with optional functions state, sample, result and connection. `filters`: below {root}. */
        node.join = (member, filters) => {
            members.add(member);
            for (const filter of filters) wanted.set(filter, (wanted.get(filter) ?? 0) + 1);
            subscribe();
        };
        node.leave = (member, filters, removed) => {
            members.delete(member);
            for (const filter of filters) {
                wanted.set(filter, wanted.get(filter) - 1);
                if (wanted.get(filter) === 0) wanted.delete(filter);
            }
            subscribe(removed);
        };

        // Subscribes to what the members need. No filter overlaps another: with MQTT 5 some brokers send one copy with
        // several subscription identifiers then, which Node-RED's broker node ignores.
        function subscribe(removed) {
            if (!broker || closed) return;
            const every = (filter) => filter.replace(/^([^/]+)\/[^/]+\/data/, "$1/+/data");
            const needed = [...wanted.keys()].filter((one) => every(one) === one || !wanted.has(every(one)));
            for (const filter of needed) {
                if (subscribed.has(filter)) continue;
                subscribed.add(filter);
                broker.subscribe(`${node.root}/${filter}`, {qos: 1}, receive, node.id);
            }
            for (const filter of subscribed) {
                if (needed.includes(filter)) continue;
                subscribed.delete(filter);
                broker.unsubscribe(`${node.root}/${filter}`, node.id, removed);
            }
        }

        function receive(topic, payload) {
            const [id, device, kind, group, last] = topic.slice(node.root.length + 1).split("/");
            let body = null;
            if (payload.length > 0) {
                try {
                    body = JSON.parse(payload.toString());
                } catch {
                    body = undefined;
                }
                if (body === null || typeof body !== "object" || Array.isArray(body))
                    return node.debug(`ignored: no JSON object on ${topic}`);
            }
            if (device === "state" && kind === undefined) return setState(id, null, body);
            if (kind === "state" || kind === "meta") return setState(id, device, body, kind);
            if (body === null) return undefined;
            if (kind === "result") return each((member) => member.result?.(id, device, body));
            if (kind === "data" && (last === undefined || last === "history")) {
                const rows = last ? body.rows : [body];
                if (Array.isArray(rows)) each((member) => member.sample?.(id, device, group, rows, Boolean(last)));
            }
            return undefined;
        }

        function setState(id, device, body, kind = "state") {
            if (!node.agents.has(id)) node.agents.set(id, {state: null, devices: new Map()});
            const agent = node.agents.get(id);
            let of = agent;
            if (device !== null) {
                if (!agent.devices.has(device)) agent.devices.set(device, {state: null, meta: null});
                of = agent.devices.get(device);
            }
            of[kind] = body;
            // A removed device or agent has empty topics.
            if (device !== null && !of.state && !of.meta) agent.devices.delete(device);
            if (!agent.state && agent.devices.size === 0) node.agents.delete(id);
            each((member) => kind === "state" ? member.state?.(id, device, body) : undefined);
        }

        if (broker) {
            // The broker node sets the status of its users at each change of the connection.
            node.status = () => {
                // The retained states arrive again with each connection. Until then no agent counts as online.
                if (broker.connected && !connected) for (const agent of node.agents.values()) agent.state = null;
                connected = broker.connected;
                each((member) => member.connection?.());
            };
            broker.register(node);
            connected = broker.connected;
            node.join({}, ["+/state", "+/+/state", "+/+/meta"]);
        } else {
            node.error("no broker is chosen: open this node and choose one");
        }
        node.on("close", (removed, done) => {
            closed = true;
            if (!broker) return done();
            for (const filter of subscribed) broker.unsubscribe(`${node.root}/${filter}`, node.id, removed);
            broker.deregister(node, done, removed);
            return undefined;
        });
    }
    RED.nodes.registerType("fxagent-agent", AgentNode);

    /** Returns the agents, devices and tags for the lists of the editor. */
    function listOf(node) {
        const tagsOf = (meta) => Object.entries(meta?.tags ?? {}).filter(([, tag]) => tag).map(([name, tag]) => ({
            name, type: tag.type, unit: tag.unit, group: tag.group, writable: tag.access === "read_write",
            min: tag.min, max: tag.max, description: tag.description}));
        return {
            connected: node.isConnected(),
            agents: [...node.agents].map(([id, agent]) => ({
                id, state: agent.state?.state ?? null,
                devices: [...agent.devices].map(([name, device]) => (
                    {name, state: device.state?.state ?? null, tags: tagsOf(device.meta)})),
            })),
        };
    }
    RED.httpAdmin.get("/fxagent/:id/agents", RED.auth.needsPermission("fxagent.read"), (request, response) => {
        const node = RED.nodes.getNode(request.params.id);
        if (node?.type !== "fxagent-agent") return response.status(404).json({error: "deploy the agent node first"});
        return response.json(listOf(node));
    });

    /** Calls `then` when the flows run: messages that a node sends earlier may be lost. */
    function whenStarted(node, then) {
        RED.events.once("flows:started", then);
        node.on("close", () => RED.events.removeListener("flows:started", then));
    }

    /** Shows the state of the connection, the agent and the device. `text`: shown if all is well. */
    function show(node, server, id, device, text) {
        if (!server.isConnected()) return node.status({fill: "red", shape: "ring", text: "no broker"});
        const agent = server.agents.get(id);
        if (!agent?.state) return node.status({fill: "grey", shape: "ring", text: `no agent ${id}`});
        if (agent.state.state !== "online")
            return node.status({fill: "red", shape: "dot", text: `agent ${agent.state.state}`});
        const state = device ? agent.devices.get(device)?.state : agent.state;
        if (!state) return node.status({fill: "grey", shape: "ring", text: `no device ${device}`});
        const fill = {online: "green", degraded: "yellow"}[state.state] ?? "red";
        const why = state.reason ? `: ${state.reason}` : "";
        return node.status({fill, shape: "dot", text: text ?? `${device || id} ${state.state}${why}`});
    }

    // --- fxagent in

    function InNode(config) {
        RED.nodes.createNode(this, config);
        const node = this;
        const server = RED.nodes.getNode(config.server);
        const {agent: id, device: only, group: onlyGroup, tag: onlyTag} = config;
        if (!server || !id) {
            node.status({fill: "red", shape: "ring", text: "not configured"});
            return;
        }
        const newest = config.order === "newest";
        const waitMs = Math.max(0, Number(config.wait ?? 10) || 0) * 1000;
        const orders = new Map();  // device → {order, timer}
        const told = new Map();    // device, null: the agent → its last state that was sent
        let started = false;

        const refresh = () => {
            const waits = [...orders.values()].some(({timer}) => timer !== null);
            show(node, server, id, only, waits ? "waits for earlier samples" : undefined);
        };
        const sendState = (device) => {
            const agent = server.agents.get(id);
            const state = device === null ? agent?.state : agent?.devices.get(device)?.state;
            // The agent publishes its states again after each connect.
            if (!state || told.get(device) === JSON.stringify(state)) return;
            told.set(device, JSON.stringify(state));
            node.send([null, {topic: device ?? id, payload: state.state, agent: id, device, ts: state.since,
                reason: state.reason ?? null, reason_text: state.reason_text ?? null, state}]);
        };

        // A sample with all its tags, in one message or in one for each tag.
        function sendSample(device, row) {
            const {group} = row;
            if (onlyGroup && group !== onlyGroup) return;
            const tags = server.agents.get(id)?.devices.get(device)?.meta?.tags ?? {};
            const common = {agent: id, device, group, ts: row.ts, seq: row.seq, boot: row.boot};
            for (const key of ["history", "late", "missing", "partial"]) if (row[key]) common[key] = row[key];
            const values = Object.entries(row.values ?? {}).filter(([tag]) => !onlyTag || tag === onlyTag);
            const bad = Object.entries(row.bad ?? {}).filter(([tag]) => !onlyTag || tag === onlyTag);
            if (values.length + bad.length === 0) return;
            if (config.send === "samples") {
                node.send([{...common, topic: `${device}/${group}`, payload: Object.fromEntries(values),
                    quality: bad.length > 0 ? "bad" : "good", bad: Object.fromEntries(bad)}, null]);
                return;
            }
            const message = (tag, more) => {
                const of = Object.hasOwn(tags, tag) ? tags[tag] : {};
                const label = of.states?.[String(Number(more.payload))];
                const named = {topic: `${device}/${tag}`, tag, unit: of.unit ?? null, ...(label && {label})};
                return {...common, ...named, ...more};
            };
            node.send([[
                ...values.map(([tag, value]) => message(tag, {payload: value, quality: "good",
                    ...(row.written?.includes(tag) && {written: true})})),
                ...bad.map(([tag, of]) => message(tag, {payload: null, quality: "bad", why: of?.why, since: of?.since,
                    last: of?.last, last_ts: of?.last_ts})),
            ], null]);
        }

        function orderOf(device) {
            if (!orders.has(device))
                orders.set(device, {order: new Order((row) => sendSample(device, row)), timer: null});
            return orders.get(device);
        }

        // Begins or ends the wait for missing samples. `again`: history arrives, so there may be more.
        function watch(of, again) {
            if (!of.order.waits) {
                clearTimeout(of.timer);
                of.timer = null;
            } else if (waitMs === 0) {
                of.order.release();
            } else if (of.timer === null) {
                of.timer = setTimeout(() => {
                    of.timer = null;
                    of.order.release();
                    refresh();
                }, waitMs);
            } else if (again) {
                of.timer.refresh();
            }
        }

        const member = {
            state(agent, device) {
                if (agent !== id || (device !== null && only && device !== only)) return;
                if (started) sendState(device);
                refresh();
            },
            sample(agent, device, group, rows, history) {
                if (agent !== id) return;
                // The agent sends the backlogs of its devices one after the other.
                if (history) for (const of of orders.values()) watch(of, true);
                if (only && device !== only) return;
                const of = orderOf(device);
                for (const row of rows) {
                    if (!Number.isSafeInteger(row?.seq)) continue;
                    const sample = {...row, group, ...(history && {history: true})};
                    if (!newest) of.order.add(sample, history);
                    else if (!history && !(of.boot === row.boot && of.seq >= row.seq)) {
                        of.boot = row.boot;
                        of.seq = row.seq;
                        sendSample(device, sample);
                    }
                }
                const waited = of.timer !== null;
                watch(of, history);
                if (waited !== (of.timer !== null)) refresh();
            },
            connection: refresh,
        };
        // All groups of the device are needed, because `seq` counts over all of them. History of other devices shows
        // that the agent has not yet sent its whole backlog.
        const filters = [`${id}/${only || "+"}/data/+`, ...(newest ? [] : [`${id}/+/data/+/history`])];
        server.join(member, filters);
        refresh();
        whenStarted(node, () => {
            started = true;
            sendState(null);
            const devices = server.agents.get(id)?.devices.keys() ?? [];
            for (const device of devices) if (!only || device === only) sendState(device);
        });
        node.on("close", (removed, done) => {
            for (const of of orders.values()) clearTimeout(of.timer);
            server.leave(member, filters, removed);
            done();
        });
    }
    RED.nodes.registerType("fxagent in", InNode);

    // --- fxagent command

    function CommandNode(config) {
        RED.nodes.createNode(this, config);
        const node = this;
        const server = RED.nodes.getNode(config.server);
        const id = config.agent;
        if (!server || !id) node.status({fill: "red", shape: "ring", text: "not configured"});
        const seconds = Number(config.seconds) > 0 ? Math.min(Number(config.seconds), MAX_SECONDS) : 10;
        const pending = new Map();     // id of the command → {device, command, msg, send, done, timer, told}
        const unanswered = new Map();  // id of a command that was answered without its result → its text
        const bounds = new Map();      // device → the longest bound_ms of its results

        function answer(msg, send, done, wire, text, more) {
            const outputs = [null, null, null];
            // Not `status`: Node-RED's debug node takes that for the status of a node.
            outputs[wire] = {...msg, payload: text, outcome: null, reason: null, result: null, sent: true, ...more};
            const {outcome, reason, sent} = outputs[wire];
            node.status({fill: ["green", "yellow", "red"][wire], shape: "dot",
                text: outcome ? [outcome, reason].filter(Boolean).join(" ") : sent ? "no result" : "nothing sent"});
            send(outputs);
            done();
        }

        // Ends the wait for a command. Only the first call for an id has an effect.
        function settle(uuid, wire, text, more) {
            const of = pending.get(uuid);
            if (!of) return;
            pending.delete(uuid);
            clearTimeout(of.timer);
            if (wire === UNKNOWN && !more.result) {
                unanswered.set(uuid, of.name);
                if (unanswered.size > MAX_UNANSWERED) unanswered.delete(unanswered.keys().next().value);
            }
            const {msg, send, done, command, device} = of;
            answer(msg, send, done, wire, `${of.name}: ${text}`, {command, device, ...more});
        }

        // Returns the device and the command, without id and expiry. Throws an Error with reason and cure.
        function prepare(msg) {
            if (!server || !id) throw new Error("no agent is chosen: open the node and choose one");
            if (!server.isConnected()) throw new Error("there is no connection to the broker: send it again later");
            const agent = server.agents.get(id);
            if (!agent?.state)
                throw new Error(`there is no agent ${id} below ${server.root}: compare them with the agent's config`);
            if (agent.state.state !== "online")
                throw new Error(`the agent ${id} is offline (${agent.state.reason}): send it again when it is online`);
            if (agent.state.commands === false)
                throw new Error(`the agent ${id} receives no commands now (${agent.state.reason}): look at its log`);
            const device = config.device || msg.device;
            if (typeof device !== "string" || !agent.devices.has(device))
                throw new Error(`the agent ${id} has no device ${JSON.stringify(device)}: `
                    + `its devices are ${[...agent.devices.keys()].join(", ")}`);
            // A target of the node is not changed by a message.
            const own = config.tag || config.address;
            const command = commandOf(device, agent.devices.get(device).meta, {
                op: config.op || msg.op,
                tag: own ? config.tag : msg.tag, address: own ? config.address : msg.address,
                value: msg.payload, type: msg.type, expect: msg.expect, verify: msg.verify, dry_run: msg.dry_run,
            });
            return {device, command};
        }

        node.on("input", (msg, send, done) => {
            let device, command;
            try {
                ({device, command} = prepare(msg));
            } catch (fault) {
                const text = `nothing was sent: ${fault.message}`;
                answer(msg, send, done, NOT_CARRIED_OUT, text, {sent: false, command: null});
                return;
            }
            const uuid = crypto.randomUUID();
            const expires = Date.now() + Math.round(seconds * 1000);
            command = {id: uuid, ...command, expires, by: config.by || "node-red"};
            const target = command.tag ?? command.address;
            const value = JSON.stringify(command.value);
            const name = [device, command.op, target, value].filter((word) => word !== undefined).join(" ");
            const waitMs = seconds * 1000 + Math.max(MARGIN_S * 1000, bounds.get(device) ?? 0);
            const of = {device, command, name, msg, send, done, acknowledged: false};
            of.timer = setTimeout(() => settle(uuid, UNKNOWN,
                `no result within ${waitMs / 1000} s. `
                + (of.acknowledged ? "" : "The broker did not acknowledge the command. ")
                + "It may have been carried out: look at the plant before you send it again", {}), waitMs);
            pending.set(uuid, of);
            // The broker discards the command after this, whatever the clocks of the machines are (MQTT 5).
            let returned = false;
            server.publish(`${server.root}/${id}/${device}/command`, JSON.stringify(command),
                {messageExpiryInterval: Math.ceil(seconds)}, (fault) => {
                    of.acknowledged = !fault;
                    if (!fault) return;
                    // Before publish() has returned nothing is on the wire. From 0x80: the broker has refused it.
                    if (!returned || fault.code >= 0x80)
                        settle(uuid, NOT_CARRIED_OUT, `nothing was sent to the agent: ${fault.message}`, {sent: false});
                });
            returned = true;
            if (pending.has(uuid)) node.status({fill: "blue", shape: "dot", text: "sent"});
        });

        const member = {
            result(agent, device, result) {
                if (agent !== id) return;
                // MQTT sends a command again if the connection breaks before the broker's answer. The agent knows the id.
                if (result.status === "DUPLICATE") {
                    if (!result.first) return;
                    result = result.first;
                }
                const uuid = result.id;
                const bound = result.t?.bound_ms;
                if (typeof bound === "number") bounds.set(device, Math.max(bounds.get(device) ?? 0, bound));
                if (pending.get(uuid)?.device === device) {
                    settle(uuid, wireOf(result), textOf(result), {outcome: result.status, reason: result.reason,
                        result, ...(result.op === "read" && {value: result.value})});
                } else if (unanswered.has(uuid)) {
                    node.warn(`${unanswered.get(uuid)}: the result came late: ${textOf(result)}`);
                    unanswered.delete(uuid);
                }
            },
            state(agent, device) {
                if (pending.size === 0 && agent === id && (device === null || device === config.device)) refresh();
            },
            connection: () => refresh(),
        };
        const refresh = () => show(node, server, id, config.device);
        const filters = [`${id}/+/result`];
        if (server && id) {
            server.join(member, filters);
            refresh();
        }
        node.on("close", (removed, done) => {
            for (const {timer, name} of pending.values()) {
                clearTimeout(timer);
                node.warn(`${name}: the node was stopped before the result. Look at the plant`);
            }
            pending.clear();
            if (server && id) server.leave(member, filters, removed);
            done();
        });
    }
    RED.nodes.registerType("fxagent command", CommandNode);
};
