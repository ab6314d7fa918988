#!/usr/bin/env python3
"""Makes blocks for the transcripts in this directory out of a recording of fxagent's flight recorder:

    tests/frames/from_recording.py RECORDING.fxrec [--fxagent build/agent/fxagent] >>tests/frames/mc_3e.txt

Prints each different exchange once, in the notation of its protocol's file, and names that file. Reads, writes, forces and
enquiries become blocks; the other exchanges are listed on standard error. The tests count the blocks: raise their numbers.
"""

import argparse
import json
import subprocess
import sys


class NoBlock(Exception):
    """The exchange has no notation here; the text says why."""


def image_of(values):
    """The project's image of explained values: words with the low byte first, bits from the lowest on."""
    if all(len(value) == 4 for value in values):
        return b"".join(int(value, 16).to_bytes(2, "little") for value in values), "words"
    if all(value in "01" for value in values):
        bits = sum(int(value) << at for at, value in enumerate(values))
        return bits.to_bytes((len(values) + 7) // 8, "little"), "bits"
    raise NoBlock("its values are neither words nor bits")


def parts_of(exchange):
    """Operation, image and kind of the values of an exchange."""
    asked, answer = exchange["request"]["explanation"], exchange["answer"]["explanation"]
    operation = asked["operation"]
    if operation == "enquire":
        return operation, b"", "none"
    if operation not in ("read", "write", "force_on", "force_off"):
        raise NoBlock(f"the operation {operation}")
    if "device" not in asked or "," in asked["device"]:
        raise NoBlock("not one place")
    if answer["operation"] == "nak":
        raise NoBlock("a refusal: write its code by hand")
    if operation == "read":
        return operation, *image_of(answer["values"])
    if operation == "write":
        return operation, *image_of(asked["values"])
    return operation, b"", "bits"


def modbus(exchange, options, protocol):
    operation, image, _ = parts_of(exchange)
    framing = protocol.removeprefix("modbus-")
    number = int.from_bytes(exchange["sent"][:2], "big") if framing == "tcp" else 0
    asked = exchange["request"]["explanation"]
    return f"{framing} {options['unit']}.{number} {operation} {asked['device']} {asked.get('count', 1)}", image


def programming_port(exchange, options, _):
    operation, image, _ = parts_of(exchange)
    asked = exchange["request"]["explanation"]
    return f"{known_model(options)} {asked.get('command_set', '-')} {operation} {asked.get('device', '-')} {len(image)}", image


def known_model(options):
    if options["model"] == "auto":
        raise NoBlock("the model is auto: set it in the recording's line `device`")
    return options["model"]


def with_points(exchange, words, bits):
    """Operation and points of protocols with reads of words and of bits."""
    operation, image, kind = parts_of(exchange)
    if operation in ("read", "write"):
        operation = {"words": words, "bits": bits}[kind].format(operation)
        points = len(image) // 2 if kind == "words" else exchange["request"]["explanation"]["count"]
    else:
        points = 1
    return operation, points, image


def computer_link(exchange, options, _):
    asked = exchange["request"]["explanation"]
    operation, points, image = with_points(exchange, "{}_words", "{}_bits")
    if operation.startswith("write"):
        operation = "write"
    elif not operation.startswith("read"):
        raise NoBlock("a force: its notation is `scatter`")
    setting = ".".join([str(options["station"]), str(options.get("message_wait_ms", 0)), str(options["format"]),
                        "sum" if options["sum_check"] else "none"])
    return f"{known_model(options)} {setting} {operation} {asked['device']} {points}", image


def mc(exchange, options, protocol):
    asked = exchange["request"]["explanation"]
    operation, points, image = with_points(exchange, "{}_words", "{}_bits")
    own = {"network": 0, "pc": 255, "module_io": 1023, "module_station": 0}  # 3C frames lack the last two
    route = [str(options.get(key, value)) for key, value in own.items()]
    if protocol == "mc-1e":
        operation = "write" if operation == "write_words" else operation
        setting = [options["code"], str(options["monitoring_timer_ms"]), str(options["pc"])]
    elif protocol in ("mc-3c", "mc-4c"):
        setting = [str(options["format"]), str(options["station"]), *route, "0"]
    else:
        number = "0"
        if protocol == "mc-4e":
            sent = exchange["sent"]
            number = (f"{int.from_bytes(sent[2:4], 'little'):04X}" if options["code"] == "binary"
                      else sent[4:8].decode())
        setting = [options["code"], number, *route]
    return f"{known_model(options)} {'.'.join(setting)} {operation} {asked['device']} {points}", image


NOTATIONS = {"fx-programming-port": programming_port, "fx-computer-link": computer_link,
             "modbus-rtu": modbus, "modbus-ascii": modbus, "modbus-tcp": modbus,
             **{f"mc-{frame}": mc for frame in ("1e", "3e", "4e", "3c", "4c")}}


def file_of(protocol):
    return "modbus.txt" if protocol.startswith("modbus") else protocol.replace("-", "_") + ".txt"


def exchanges(frames):
    """Each request with the answer right behind it, both explained as good."""
    for request, answer in zip(frames, frames[1:]):
        if (request["way"], answer["way"]) == ("out", "in") and all(
                frame.get("explanation", {}).get("ok") for frame in (request, answer)):
            yield {"request": request, "answer": answer, "sent": bytes.fromhex(request["hex"])}


def blocks(head, frames):
    devices = {device["name"]: device for device in head["devices"]}
    seen = set()
    for exchange in exchanges(frames):
        device = devices[exchange["request"]["device"]]
        try:
            line, image = NOTATIONS[device["protocol"]](exchange, device["options"], device["protocol"])
        except NoBlock as why:
            yield None, f"{exchange['request']['says']}: {why}"
            continue
        block = [f"# for {file_of(device['protocol'])}: recorded on {head['link']}, {exchange['request']['says']} (captured)", line,
                 ">> " + exchange["request"]["hex"], "<< " + exchange["answer"]["hex"]]
        if image:
            block.append("= " + image.hex(" ").upper())
        # Exchanges that differ in their number alone are equal.
        key = (line.split(" ", 2)[2], exchange["answer"]["says"])
        if key not in seen:
            seen.add(key)
            yield "\n".join(block) + "\n", None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording")
    parser.add_argument("--fxagent", default="fxagent", help="the program (fxagent)")
    call = parser.parse_args()
    done = subprocess.run([call.fxagent, "replay", call.recording, "--json"], stdout=subprocess.PIPE, text=True)
    if done.returncode != 0:
        return done.returncode
    head, *frames = [json.loads(line) for line in done.stdout.splitlines()]
    for block, skipped in blocks(head, frames):
        print(block if block else "no block for " + skipped, file=sys.stdout if block else sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
