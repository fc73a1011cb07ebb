#!/bin/sh
# rosbags' AnyReader on an MCAP of ROS 2 that has a topic in JSON beside one in CDR, as loggers for Foxglove
# write them.
#
# Seen with rosbags 0.11.9 and mcap 1.6.0: the file with the topic in CDR alone is read; with the other
# one beside it, opening ends in KeyError: 'jsonschema', though nobody asked for that topic. mcap's own
# reader reads both.
#
# Guess beforehand: a topic whose encoding is not known is left out, as one without a type definition
# can be, and the topics of ROS are read.
# What seems to happen: the schemas of all topics are looked up by their encoding as the file is opened,
# and JSON's is not in the table.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check "rosbags==0.11.9" "mcap==1.6.0" "numpy==2.4.6"
cat > read.py <<'PYTHON'
import sys
from importlib.metadata import version
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_HUMBLE)
kind = "std_msgs/msg/String"
text = bytes(store.serialize_cdr(store.types[kind]("x"), kind))


def written(name, both):
    with Path(name).open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        schema = writer.register_schema(kind, "ros2msg", b"string data")
        writer.add_message(writer.register_channel("/text", "cdr", schema), 1, text, 1)
        if both:
            schema = writer.register_schema("any", "jsonschema", b'{"type": "object"}')
            writer.add_message(writer.register_channel("/any", "json", schema), 2, b"{}", 2)
        writer.finish()
    return Path(name)


def read(path):
    try:
        with AnyReader([path], default_typestore=store) as reader:
            return [connection.topic for connection, _, _ in reader.messages()]
    except Exception as error:
        return f"{type(error).__name__}: {error}"


print(f"rosbags {version('rosbags')}, mcap {version('mcap')}")
alone, beside = read(written("alone.mcap", False)), read(written("both.mcap", True))
with Path("both.mcap").open("rb") as stream:
    own = [channel.topic for _, channel, _ in make_reader(stream).iter_messages()]
print(f"CDR alone: {alone}; beside JSON: {beside}; mcap's reader: {own}")
sys.exit((alone, own) != (["/text"], ["/text", "/any"]) or "jsonschema" not in beside)
PYTHON
env/bin/python read.py
