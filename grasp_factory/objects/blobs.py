"""Irregular shapes: the 1000 random_urdfs of pybullet_data, without those too large or thin."""

from __future__ import annotations

import csv
from importlib import resources

from grasp_factory.objects.base import FiniteSet, ObjectModel, UrdfFile

SMALLEST_SIDE = (0.015, 0.075)
"""Metres. Thinner objects lie below the fingertips; thicker ones fit into no gripper."""
LARGEST_MIDDLE_SIDE = 0.100
"""Metres. Objects come to rest on their largest face, so the fingers must span the middle side."""


def _models() -> dict[str, ObjectModel]:
    """Read the bounding boxes (metres, object frame) of all shapes with finite vertices.

    ``blobs.csv`` holds the boxes of the OBJ files at the URDFs' scale of 0.015; shape 168 is
    not in it, because its vertices are not numbers.
    """
    table = resources.files("grasp_factory.objects") / "blobs.csv"
    models = {}
    for row in csv.DictReader(table.read_text(encoding="ascii").splitlines()):
        lower = (float(row["lower_x"]), float(row["lower_y"]), float(row["lower_z"]))
        upper = (float(row["upper_x"]), float(row["upper_y"]), float(row["upper_z"]))
        small, middle, _ = sorted(u - low for u, low in zip(upper, lower, strict=True))
        if SMALLEST_SIDE[0] <= small <= SMALLEST_SIDE[1] and middle <= LARGEST_MIDDLE_SIDE:
            model = ObjectModel(
                object_id=f"blobs/{row['id']}",
                family="blob",
                body=UrdfFile(path=f"random_urdfs/{row['id']}/{row['id']}.urdf"),
                lower=lower,
                upper=upper,
                mass=0.1,  # of every random_urdfs file
                lateral_friction=0.5,
            )
            models[model.object_id] = model
    return models


BLOBS = FiniteSet(
    name="blobs",
    description="irregular shapes (pybullet_data's random_urdfs) that fit between the fingers",
    models=_models(),
)
