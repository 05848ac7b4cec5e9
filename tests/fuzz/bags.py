"""Readers of ROS bags: each input is a bag, which is imported in this process, without limits."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from fuzz.target import Target
from support import bags

from grasp_factory.apps.bag_import.extraction import LAYOUTS, ImportJob, extract
from grasp_factory.errors import GraspFactoryError

START = 1_700_000_000_000_000_000
PIXELS = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
CONTENTS: tuple[bags.Content, ...] = (
    ("/camera/image_raw", bags.IMAGE, START, bags.image(PIXELS, "rgb8")),
    ("/camera/depth", bags.IMAGE, START, bags.image(PIXELS[..., 0].astype(np.uint16), "16UC1")),
    ("/camera/camera_info", bags.INFO, START, {}),
    ("/imu", bags.IMU, START, bags.imu((0, 0, 9.81), (0, 0, 0))),
    ("/odom", bags.ODOMETRY, START, bags.odometry((0, 0, 0), (0, 0, 0, 1))),
    ("/joints", bags.JOINTS, START, {"name": ["a"], "position": np.ones(1)}),
    ("/ft", bags.WRENCH, START, bags.wrench((0, 0, 1), (0, 0, 0))),
)


def parse(data: bytes) -> None:
    """Import a bag to every layout."""
    for layout in LAYOUTS:
        with tempfile.TemporaryDirectory() as name:
            bag, out, aside = (Path(name) / part for part in ("bag", "out", "aside"))
            bag.write_bytes(data)
            out.mkdir()
            aside.mkdir()
            job = ImportJob(bag=bag, folder=out, aside=aside, layout=layout, topics=())
            extract(job, lambda step: None)


def target(write: Callable[[Path, tuple[bags.Content, ...]], Path], pattern: str) -> Target:
    """Return a target whose example is the file that a function writes."""

    def examples() -> list[bytes]:
        with tempfile.TemporaryDirectory() as name:
            bag = write(Path(name) / "b", CONTENTS)
            file = next(bag.glob(pattern)) if pattern else bag
            return [file.read_bytes()]

    return Target(parse, examples, (GraspFactoryError, MemoryError))


TARGETS = {
    "bag of ROS 1": target(bags.ros1, ""),
    "MCAP file": target(bags.mcap, "*.mcap"),
    "bag in SQLite": target(bags.sqlite3, "*.db3"),
}
