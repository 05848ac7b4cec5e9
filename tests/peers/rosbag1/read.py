"""Reads bags with ROS 1's own library, and compares the types with ROS's own packages."""

import sys
from pathlib import Path

import numpy as np
import rosbag
from roslib.message import get_message_class

sys.path.insert(0, str(Path(__file__).parents[1]))
from flat_messages import flat_arrays

arrays = {}
for path in sorted(Path(sys.argv[1]).glob("*.bag")):
    with rosbag.Bag(str(path)) as bag:
        for topic, facts in bag.get_type_and_topic_info().topics.items():
            md5 = bag.get_type_and_topic_info().msg_types[facts.msg_type]
            assert get_message_class(facts.msg_type)._md5sum == md5, (topic, facts.msg_type)
        messages = (
            (topic, time.to_nsec(), message) for topic, message, time in bag.read_messages()
        )
        found = flat_arrays(messages)
    arrays |= {f"{path.stem}|{key}": values for key, values in found.items()}
np.savez(sys.argv[2], **arrays)
