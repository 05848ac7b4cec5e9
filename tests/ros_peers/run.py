"""Sends episodes as topics to a real rclpy, which sends them back, and compares with the store.

A peer is a folder beside this file with ``requirements.txt``, an rclpy from PyPI; ``echo.py`` runs
there. All runs in a network namespace: store -> ``capture publish`` -> rclpy -> ``capture collect``
-> MCAP -> ``import`` -> store. What rclpy read, what the MCAP file has by MCAP's own library, and
the new store are compared with the first store, value by value. ``/tf`` and ``/tf_static`` are left
out: PyPI has no tf2_msgs.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_ros2.decoder import DecoderFactory
from peers.flat_messages import flat_arrays
from peers.run import STORE, python_of
from support.bag_contents import equal_episode
from support.network_namespace import Namespace, network_namespace

from grasp_factory.curation.restore.restoring import restore
from grasp_factory.dataset.dataset import Dataset

HERE = Path(__file__).parent
EPISODES = 2
LONGEST_S = 180
"""For an episode, there and back."""
ECHO = "/echo"
COMMAND = (sys.executable, "-m", "grasp_factory", "capture")
NO_CLASSES = {"tf2_msgs/msg/TFMessage"}
"""Types that PyPI's packages do not have."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Journey:
    """Where episodes are sent from, and through."""

    dataset: Dataset
    namespace: Namespace
    python: str
    """The Python that has rclpy."""
    work: Path
    """A folder for files."""

    def there_and_back(
        self, row: int, plan: dict[str, tuple[str, int]]
    ) -> tuple[dict[str, Any], Path]:
        """Return what rclpy read, and the file with what it sent."""
        listed, out, collected = (
            self.work / name for name in ("plan.json", "read.npz", "back.mcap")
        )
        listed.write_text(json.dumps(plan))
        collected.unlink(missing_ok=True)
        echoes = ",".join(f"{ECHO}{topic}" for topic in plan)
        wait = ("--wait", 60)
        names = ("--topics", ",".join(plan), "--wait-for-all")
        self._run(
            (self.python, HERE / "echo.py", listed, out),
            (*COMMAND, "collect", "--topics", echoes, "--out", collected, "--silence", 6, *wait),
            (*COMMAND, "publish", self.dataset.path, row, *names, *wait),
        )
        with np.load(out, allow_pickle=False) as arrays:
            return dict(arrays), collected

    def _run(self, *commands: tuple[object, ...]) -> None:
        """Run commands at the same time."""
        running = [
            subprocess.Popen(self.namespace.command(*command), stdout=subprocess.DEVNULL)
            for command in commands
        ]
        try:
            failed = [each.args for each in running if each.wait(timeout=LONGEST_S)]
        finally:
            for each in running:
                each.kill()
        assert not failed, failed


def check(peer: str, work: Path) -> str:
    """Send episodes there and back; return what was found as a line."""
    python, dataset, export = python_of(HERE / peer), Dataset(work / "store.zarr"), work / peer
    dataset.export("rosbag2", export, indices=list(range(EPISODES)))
    heard = back = 0
    with network_namespace() as namespace:
        journey = Journey(dataset=dataset, namespace=namespace, python=python, work=work)
        for row in range(EPISODES):
            bag = export / f"{row:06d}/{row:06d}.mcap"
            read, collected = journey.there_and_back(row, plan_of(bag))
            heard += equal_episode(dataset[row], read)
            back += equal_episode(dataset[row], read_mcap(collected))
            put_back(collected, bag)
    again = restore(export, work / f"{peer}.zarr").same
    assert again == EPISODES, f"{again} of {EPISODES} episodes are the same in the new store"
    return (
        f"{peer}: {heard} values are equal in rclpy, {back} in the MCAP file that came back, and"
        f" {again} of {EPISODES} episodes in the store that was made of it"
    )


def plan_of(bag: Path) -> dict[str, tuple[str, int]]:
    """Return type and number of messages of each topic that rclpy has a class for."""
    with bag.open("rb") as file:
        found = [(c.topic, s.name) for s, c, _ in make_reader(file).iter_messages() if s]
    counts = Counter(topic for topic, _ in found)
    return {topic: (kind, counts[topic]) for topic, kind in found if kind not in NO_CLASSES}


def read_mcap(path: Path) -> dict[str, Any]:
    """Return the fields of the messages that came back, by MCAP's own library."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = (
            (channel.topic.removeprefix(ECHO), stamp_of(message), message)
            for _, channel, _, message in reader.iter_decoded_messages()
        )
        return flat_arrays(decoded)


def put_back(collected: Path, bag: Path) -> None:
    """Replace the bag of an export by the messages that came back."""
    bag.unlink()
    with collected.open("rb") as source, bag.open("wb") as target:
        writer, schemas, channels = Writer(target, compression=CompressionType.NONE), {}, {}
        writer.start(profile="ros2")
        for schema, channel, message in make_reader(source).iter_messages():
            assert schema
            if channel.id not in channels:
                names = schema.name, schema.encoding, schema.data
                schemas[schema.id] = writer.register_schema(*names)
                topic = channel.topic.removeprefix(ECHO)
                channels[channel.id] = writer.register_channel(topic, "cdr", schemas[schema.id])
            times = message.log_time, message.data, message.publish_time
            writer.add_message(channels[channel.id], *times)
        writer.finish()


def stamp_of(message: Any) -> int:
    """Return the header's stamp, ns; 0 without a header."""
    header = getattr(message, "header", None)
    return header.stamp.sec * 10**9 + header.stamp.nanosec if header else 0


def main() -> int:
    peers = sorted(path.parent.name for path in HERE.glob("*/requirements.txt"))
    wanted = sys.argv[1:] or peers
    if unknown := set(wanted) - set(peers):
        print(f"unknown peers: {', '.join(sorted(unknown))} (valid: {', '.join(peers)})")
        return 2
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        make = (sys.executable, "-m", "grasp_factory", "generate", "--quiet", "--out")
        cameras = ("--camera", "front", "--camera", "wrist")
        subprocess.run([*make, work / "store.zarr", *STORE, *cameras], check=True)
        for peer in wanted:
            try:
                print(check(peer, work), flush=True)
            except (AssertionError, subprocess.SubprocessError) as error:
                failed = 1
                print(f"{peer}: FAILED: {error}", flush=True)
    return failed


if __name__ == "__main__":
    sys.exit(main())
