"""Reads bags with SQLite, and their messages with the decoder of MCAP's authors."""

import sqlite3
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

sys.path.insert(0, str(Path(__file__).parents[1]))
from flat_messages import flat_arrays

QUERY = """
SELECT topics.name, messages.timestamp, messages.data, topics.type,
       message_definitions.encoding, message_definitions.encoded_message_definition
FROM messages JOIN topics ON topics.id = messages.topic_id
JOIN message_definitions ON message_definitions.topic_type = topics.type
ORDER BY messages.timestamp, messages.id
"""


def messages_of(path):
    decoders = {}
    with closing(sqlite3.connect(path)) as file:
        for topic, stamp, data, kind, encoding, definition in file.execute(QUERY):
            if kind not in decoders:
                schema = Schema(1 + len(decoders), definition.encode(), encoding, kind)
                decoders[kind] = factory.decoder_for("cdr", schema)
            yield topic, stamp, decoders[kind](data)


arrays = {}
for path in sorted(Path(sys.argv[1]).glob("*/*.db3")):
    factory = DecoderFactory()
    found = flat_arrays(messages_of(path))
    arrays |= {f"{path.stem}|{key}": values for key, values in found.items()}
np.savez(sys.argv[2], **arrays)
