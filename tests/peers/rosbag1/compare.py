"""Compares what ROS 1's own rosbag reads with the store."""

from __future__ import annotations

from support.bag_contents import equal_values as compare

FORMAT = "rosbag1"
SETTINGS: dict[str, str] = {}
GENERATE = ("--camera", "front", "--camera", "wrist")

__all__ = ["FORMAT", "GENERATE", "SETTINGS", "compare"]
