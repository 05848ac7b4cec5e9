"""Position and size of the table: the robot's base is the origin, the table top is z = 0."""

from __future__ import annotations

TABLE_CENTER_XY = (0.45, 0.0)
"""Metres; the robot's base, at the origin, is on the table, 0.25 m from its near edge."""
TABLE_SIZE = (1.40, 1.40, 0.05)
"""Metres along x, y and z."""
TABLE_HEIGHT = 0.75
"""Metres from the floor to the table top, which is z = 0."""
