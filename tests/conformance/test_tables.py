"""What holds for the row of any table: it knows its name and says in a line what it is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from grasp_factory.capture.devices import DEVICES
from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.executors import EXECUTORS
from grasp_factory.core.sensors import SENSORS
from grasp_factory.objects import OBJECT_SETS
from grasp_factory.policies import POLICIES
from grasp_factory.robots import ROBOTS
from grasp_factory.writers.exporters import EXPORTERS

TABLES: dict[str, Mapping[str, Any]] = {
    "cameras": CAMERAS,
    "devices": DEVICES,
    "executors": EXECUTORS,
    "exporters": EXPORTERS,
    "objects": OBJECT_SETS,
    "policies": POLICIES,
    "robots": ROBOTS,
    "sensors": SENSORS,
}


@pytest.mark.parametrize("kind", TABLES)
def test_a_tables_rows_bear_their_names_and_a_line_of_description(kind: str) -> None:
    for name, row in TABLES[kind].items():
        assert row.name == name
        assert name.isidentifier()
        assert 10 < len(row.description) <= 100
        assert "\n" not in row.description
