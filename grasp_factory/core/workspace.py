"""Where the table is: the robot's base is the origin, the table top is z = 0."""

from __future__ import annotations

TABLE_CENTER_XY = (0.45, 0.0)
"""Metres; the robot's base, at the origin, stands 0.25 m inside the table's near edge."""
TABLE_SIZE = (1.40, 1.40, 0.05)
TABLE_HEIGHT = 0.75
"""Metres between floor and table top, which is z = 0."""
