"""Reads bags with the library of MCAP's authors."""

import sys
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

sys.path.insert(0, str(Path(__file__).parents[1]))
from flat_messages import flat_arrays

arrays = {}
for path in sorted(Path(sys.argv[1]).glob("*/*.mcap")):
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = reader.iter_decoded_messages()
        messages = (
            (channel.topic, sent.log_time, message) for _, channel, sent, message in decoded
        )
        found = flat_arrays(messages)
    arrays |= {f"{path.stem}|{key}": values for key, values in found.items()}
np.savez(sys.argv[2], **arrays)
