// Makes a command of a message and checks it with the device's meta (interface.md, sections 3 and 5). The agent checks
// everything again; the checks here answer at once and name the cure.
"use strict";

const OPS = ["write", "force_on", "force_off", "read", "run", "stop"];
const INTEGERS = ["int16", "uint16", "int32", "uint32", "int64", "uint64", "bcd16", "bcd32"];
const PLAIN_NUMBER = /^\s*[-+]?\d+(\.\d+)?\s*$/;
const quoted = (value) => JSON.stringify(value) ?? String(value);

/** Returns the value for a tag, as the agent takes it. Throws an Error with reason and cure. */
function valueFor(name, tag, value) {
    if (value === undefined || value === null || value === "")
        throw new Error(`there is no value for ${name}: send it in msg.payload`);
    if (tag.count !== undefined) {
        if (!Array.isArray(value) || value.length !== tag.count)
            throw new Error(`${name} takes an array of ${tag.count} values, not ${quoted(value)}`);
        const element = {...tag, count: undefined};
        return value.map((one, at) => valueFor(`element ${at} of ${name}`, element, one));
    }
    if (tag.type === "string") {
        if (typeof value !== "string") throw new Error(`${name} takes a text, not ${quoted(value)}`);
        return value;
    }
    if (tag.type === "bool") {
        if (![true, false, 0, 1].includes(value))
            throw new Error(`${name} is a bool: send true, false, 1 or 0, not ${quoted(value)}`);
        return value;
    }
    const whole = INTEGERS.includes(tag.type) && (tag.scale ?? 1) === 1 && Number.isInteger(tag.offset ?? 0);
    if (typeof value === "string") {  // forms and dashboards send text
        if (!PLAIN_NUMBER.test(value))
            throw new Error(`${name} takes a number, not the text ${quoted(value)}: send a number in msg.payload`);
        // Beyond 2^53 a number in JavaScript loses digits, so the text remains.
        const number = Number(value);
        if (INTEGERS.includes(tag.type) && !value.includes(".") && !Number.isSafeInteger(number))
            return value.trim().replace(/^\+/, "");
        value = number;
    }
    if (typeof value !== "number" || !Number.isFinite(value))
        throw new Error(`${name} takes a number, not ${quoted(value)}: send a number in msg.payload`);
    if (whole && !Number.isInteger(value))
        throw new Error(`${name} is a whole number (${tag.type}), not ${value}: round it first`);
    return value;
}

/**
 * Returns a command without `id` and `expires`. `wanted` has op, tag, address, value, type, expect, verify, dry_run.
 * `meta`: of the device; undefined if it is not known. Throws an Error with reason and cure.
 */
function commandOf(device, meta, wanted) {
    const {op, tag, address} = wanted;
    if (!OPS.includes(op)) throw new Error(`${quoted(op)} is no command: choose one of ${OPS.join(", ")}`);
    const command = {op};
    if (op !== "run" && op !== "stop") {
        if (Boolean(tag) === Boolean(address))
            throw new Error(`${op} needs a tag or an address: choose one in the node, or send msg.tag or msg.address`);
        if (tag) {
            if (!meta) throw new Error(`the tags of ${device} are not known: its topic meta is empty`);
            const known = Object.hasOwn(meta.tags, tag) ? meta.tags[tag] : undefined;
            if (!known) {
                const names = Object.keys(meta.tags);
                throw new Error(`${device} has no tag ${quoted(tag)}: its tags are ${names.slice(0, 20).join(", ")}`
                    + (names.length > 20 ? ` and ${names.length - 20} more` : ""));
            }
            if (op !== "read" && known.access !== "read_write")
                throw new Error(`${tag} of ${device} may not be written: set "access" in the agent's config`);
            if (op.startsWith("force") && known.type !== "bool")
                throw new Error(`${op} needs a bit, and ${tag} is ${known.type}: use write`);
            command.tag = tag;
            if (op === "write") command.value = valueFor(tag, known, wanted.value);
        } else {
            command.address = address;
            if (wanted.type !== undefined) command.type = wanted.type;
            if (op === "write") {
                if (wanted.value === undefined || wanted.value === null || wanted.value === "")
                    throw new Error(`there is no value for ${address}: send it in msg.payload`);
                command.value = wanted.value;
            }
        }
    }
    for (const key of ["expect", "verify", "dry_run"])
        if (wanted[key] !== undefined) command[key] = wanted[key];
    return command;
}

const SUCCEEDED = 0, NOT_CARRIED_OUT = 1, UNKNOWN = 2;

/** Returns the output for a result. */
function wireOf(result) {
    if (result.status === "SUCCEEDED") return SUCCEEDED;
    // The contract promises for these that nothing was carried out, with one exception.
    if (["REJECTED", "EXPIRED"].includes(result.status)) return NOT_CARRIED_OUT;
    if (result.status === "FAILED" && result.reason !== "verify_mismatch") return NOT_CARRIED_OUT;
    return UNKNOWN;
}

/** Returns a result in one line, for a person. */
function textOf(result) {
    const why = [result.reason, result.detail].filter(Boolean).join(": ");
    const read = result.verify && result.verify.read !== undefined ? `, read back ${quoted(result.verify.read)}` : "";
    const part = result.of !== undefined ? `, ${result.done} of ${result.of} carried out` : "";
    return result.status + (why ? ` (${why})` : "") + part + read;
}

module.exports = {commandOf, wireOf, textOf, SUCCEEDED, NOT_CARRIED_OUT, UNKNOWN};
