"""Runs with a real rclpy: notes all messages of topics, and sends each again on another topic.

``echo.py PLAN OUT``: the plan is JSON, {topic: [type, number of messages]}. Each message goes from
TOPIC to /echo/TOPIC. At the end OUT has what rclpy read, ``np.savez(out, **flat_arrays)``.
"""

import importlib
import json
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import rclpy
from rclpy.duration import Duration
from rclpy.qos import QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy

sys.path.insert(0, str(Path(__file__).parents[1] / "peers"))
from flat_messages import flat_arrays

LONGEST_S = 120.0
QUALITY = QoSProfile(
    history=QoSHistoryPolicy.KEEP_ALL, reliability=QoSReliabilityPolicy.RELIABLE, depth=1
)


def message_class(kind):
    package, _, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def spin_until(node, is_over):
    end = time.monotonic() + LONGEST_S
    while not is_over():
        assert time.monotonic() < end, f"not over after {LONGEST_S} s"
        rclpy.spin_once(node, timeout_sec=0.05)


def stamp_of(message):
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return stamp.sec * 10**9 + stamp.nanosec if stamp else 0


plan = json.loads(Path(sys.argv[1]).read_text())
rclpy.init()
node = rclpy.create_node("echo")
publishers = {
    name: node.create_publisher(message_class(kind), f"/echo{name}", QUALITY)
    for name, (kind, _) in plan.items()
}
spin_until(node, lambda: all(each.get_subscription_count() for each in publishers.values()))
time.sleep(0.5)
seen = []


def note(name, message):
    seen.append((name, stamp_of(message), message))
    publishers[name].publish(message)


subscriptions = [
    node.create_subscription(message_class(kind), name, partial(note, name), QUALITY)
    for name, (kind, _) in plan.items()
]
expected = sum(count for _, count in plan.values())
spin_until(node, lambda: len(seen) >= expected)
for publisher in publishers.values():
    assert publisher.wait_for_all_acked(Duration(seconds=20))
np.savez(sys.argv[2], **flat_arrays(seen))
print(json.dumps({"messages": len(seen)}))
node.destroy_node()
rclpy.shutdown()
