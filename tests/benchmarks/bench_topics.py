"""Two cameras of 640x480 at 30 Hz, an IMU at 400 Hz and a force-torque sensor at 1 kHz as topics.

    PYTHONPATH=tests python -m benchmarks.bench_topics --seconds 60

One process plays them, another one collects them into an MCAP file; both in a network of their own.
Lost are messages that were sent and did not come. ``--best-effort`` sends nothing twice.
"""

from __future__ import annotations

import argparse
import heapq
import json
import resource
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from support.network_namespace import network_namespace

from grasp_factory.capture.ros2.network import Participant, Ros2Network, small_socket_buffers
from grasp_factory.capture.ros2.playing import PlayedMessage, PlaySettings, TopicPlayer
from grasp_factory.capture.ros2.quality_of_service import Reliability
from grasp_factory.core.text_format import size_text
from grasp_factory.writers.exporters.rosbag.bag_files import ros2_types
from grasp_factory.writers.exporters.rosbag.message_maker import MessageMaker
from grasp_factory.writers.exporters.rosbag.topics import Topic

IMAGE, IMU, WRENCH = (
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/Imu",
    "geometry_msgs/msg/WrenchStamped",
)
STREAMS = (
    (Topic(name="/left/image", kind=IMAGE), 30),
    (Topic(name="/right/image", kind=IMAGE), 30),
    (Topic(name="/arm/imu", kind=IMU), 400),
    (Topic(name="/wrist/wrench", kind=WRENCH), 1000),
)
"""Topics and their rates, Hz."""
WIDTH, HEIGHT = 640, 480
_STAMP = struct.Struct("<iI")


def template(kind: str) -> bytes:
    """Return the bytes of a message; its stamp follows the first four."""
    types = ros2_types()
    make = MessageMaker(types)
    values: dict[str, Any] = {"header": make.header(0, "frame")}
    if kind == IMAGE:
        pixels = np.random.default_rng(0).integers(0, 256, WIDTH * HEIGHT * 3, np.uint8)
        size = {"height": HEIGHT, "width": WIDTH, "step": WIDTH * 3}
        values |= {"encoding": "rgb8", "data": pixels, **size}
    return bytes(types.serialize_cdr(make(kind, **values), kind, little_endian=True))


def stream(topic: Topic, rate: int, seconds: float) -> Iterator[PlayedMessage]:
    data = template(topic.kind)
    head, rest = data[:4], data[4 + _STAMP.size :]
    for k in range(round(rate * seconds)):
        stamp = 10**9 + round(k * 10**9 / rate)
        yield PlayedMessage(stamp, topic.name, head + _STAMP.pack(*divmod(stamp, 10**9)) + rest)


def send(seconds: float, reliability: Reliability) -> None:
    """Play the streams; print what was sent."""
    settings = PlaySettings(waits_for_all=True, match_s=30.0, reliability=reliability, depth=0)
    player = TopicPlayer(Participant(Ros2Network()), settings)
    player.announce([topic for topic, _ in STREAMS])
    player.wait_for_subscribers()
    merged = heapq.merge(*(stream(topic, rate, seconds) for topic, rate in STREAMS))
    played = player.play(merged, lambda: None)
    used = resource.getrusage(resource.RUSAGE_SELF)
    cpu = (used.ru_utime + used.ru_stime) / played.duration_s
    print(json.dumps({"sent": dict(played.sent), "latest_s": played.latest_s, "cores": cpu}))


def measure(seconds: float, reliability: Reliability) -> int:
    """Send, collect and print what was lost; return its number."""
    with network_namespace() as namespace, tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "load.mcap"
        names = ",".join(topic.name for topic, _ in STREAMS)
        collect = (sys.executable, "-m", "grasp_factory", "capture", "collect", "--json")
        collecting = subprocess.Popen(
            namespace.command(
                *collect, "--topics", names, "--silence", 2, "--out", out, "--wait", 30
            ),
            stdout=subprocess.PIPE,
        )
        sending = (sys.executable, "-m", "benchmarks.bench_topics", "--send", reliability.value)
        done = subprocess.run(
            namespace.command(*sending, "--seconds", seconds), stdout=subprocess.PIPE, check=True
        )
        said, _ = collecting.communicate()
        assert collecting.returncode == 0
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return report(json.loads(done.stdout), json.loads(said), seconds, used.ru_utime + used.ru_stime)


def report(sent: Any, collected: Any, seconds: float, cpu_s: float) -> int:
    counts = {topic["name"]: topic for topic in collected["topics"]}
    lost = 0
    for name, number in sent["sent"].items():
        found = counts[name]
        lost += number - found["count"]
        print(
            f"{name}: sent {number}, collected {found['count']}, missing by stamps"
            f" {found['missing']}, dropped {found['dropped']}"
        )
    print(
        f"lost {lost} of {sum(sent['sent'].values())} in {seconds:g} s;"
        f" {size_text(collected['bytes'] / seconds)}/s; sender {sent['cores']:.2f} cores, latest"
        f" {1e3 * sent['latest_s']:.0f} ms late; both with start {cpu_s / seconds:.2f} cores"
    )
    if hint := small_socket_buffers():
        print(hint)
    return lost


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--best-effort", action="store_true")
    parser.add_argument("--send", choices=[each.value for each in Reliability])
    options = parser.parse_args()
    if options.send:
        send(options.seconds, Reliability(options.send))
        return 0
    kind = Reliability.BEST_EFFORT if options.best_effort else Reliability.RELIABLE
    return 1 if measure(options.seconds, kind) else 0


if __name__ == "__main__":
    sys.exit(main())
