"""Files of tests and benches."""

import json
import os


def read_text(path):
    with open(path, encoding="utf-8") as text:
        return text.read()


def read_json(path):
    return json.loads(read_text(path))


def write_text(path, text, mode=None):
    """Writes a file, with these permissions if they are given, and returns its path."""
    with open(path, "w", encoding="utf-8") as out:
        out.write(text)
    if mode is not None:
        os.chmod(path, mode)
    return path


def write_json(path, value):
    """Writes a file, indented as a config is, and returns its path."""
    return write_text(path, json.dumps(value, indent=1))
