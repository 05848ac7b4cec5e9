"""All faults, room by room. Change a text when its code moves; add faults, and take none out."""

from __future__ import annotations

from faults.fault import Fault
from faults.table import (
    apps,
    capture,
    far_away,
    making,
    objects,
    recordings,
    robots,
    simulation,
    stores,
)

FAULTS: tuple[Fault, ...] = (
    *robots.FAULTS,
    *recordings.FAULTS,
    *objects.FAULTS,
    *simulation.FAULTS,
    *stores.FAULTS,
    *far_away.FAULTS,
    *making.FAULTS,
    *apps.FAULTS,
    *capture.FAULTS,
)
