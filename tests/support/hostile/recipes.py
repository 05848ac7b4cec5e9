"""Recipes and errors of rows."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from support.hostile.table import ATTACKS, ESCAPE, FORMULA, attack

from grasp_factory.dataset.row_codec import fixed
from grasp_factory.dataset.row_integrity import QUARANTINE_PATHS, quarantine_checksum

Change = Callable[[dict[str, Any]], Any]
"""Changes a recipe, or returns another one."""


@dataclass(frozen=True)
class Recipe:
    """Change the recipe of a row."""

    change: Change
    row: int = 0
    is_quarantined: bool = True
    """Mark the row as quarantined, so that its checksum is right."""

    def __call__(self, store: Path, outside: Path) -> None:
        """Attack."""
        array = zarr.open_array(store / "episodes/spec", mode="r+")
        plain = json.loads(str(array[self.row]))
        changed = self.change(plain)
        spec = json.dumps(plain if changed is None else changed)
        if self.is_quarantined:
            quarantined(store, self.row, spec, "it failed")
        else:
            (store / "packed/0-1.npz").unlink(missing_ok=True)
            array[self.row] = spec


def quarantined(store: Path, row: int, spec: str, error: str) -> None:
    """Mark a row as quarantined, with a valid checksum."""
    (store / "packed/0-1.npz").unlink(missing_ok=True)  # it would show the row as it was
    arrays = {p: zarr.open_array(store / p, mode="r+") for p in QUARANTINE_PATHS}
    values = {"episodes/spec": spec, "episodes/error": error}
    for path, text in values.items():
        arrays[path][row] = text
    zarr.open_array(store / "episodes/status", mode="r+")[row] = 2
    found = {path: fixed(np.asarray(array[row])) for path, array in arrays.items()}
    zarr.open_array(store / "episodes/checksum", mode="r+")[row] = quarantine_checksum(found)


def _target(**more: Any) -> Callable[[dict[str, Any]], None]:
    return lambda plain: plain["objects"][0].update(more)


ATTACKS |= {
    "a recipe of images of 30000 x 30000": Recipe(lambda p: p.update(resolution=[30000, 30000])),
    "a recipe of images of negative size": Recipe(lambda p: p.update(resolution=[-5, 7])),
    "a recipe of images of 4096 x 4096": Recipe(lambda p: p.update(resolution=[4096, 4096])),
    "a recipe of images of no size": Recipe(lambda p: p.update(resolution=[0, 0])),
    "a recipe of 3,000 objects": Recipe(lambda p: p.update(objects=p["objects"][:1] * 3000)),
    "a recipe without an object": Recipe(lambda p: p.update(objects=[])),
    "a recipe with a rate of 0": Recipe(lambda p: p.update(record_hz=0)),
    "a recipe with a rate of 1e9": Recipe(lambda p: p.update(record_hz=10**9)),
    "a recipe with a rate of 2^31": Recipe(lambda p: p.update(imu_hz=2**31)),
    "a recipe with a seed of 2^70": Recipe(lambda p: p.update(seed=2**70)),
    "a recipe that is slow": Recipe(
        lambda p: p["motion"].update(
            approach_speed=0.01, lift_speed=0.01, closing_speed=0.01, hold_s=3.0, speed_scale=0.05
        )
    ),
    "a recipe with steps of 1e12 Hz": Recipe(
        lambda p: p["physics"].update(free_hz=10**12, contact_hz=10**12)
    ),
    "a recipe with an object of 1e300 kg": Recipe(_target(mass=1e300)),
    "a recipe with an object of NaN kg": Recipe(_target(mass=float("nan"))),
    "a recipe with an object that is a path": Recipe(_target(object_id="../../../../etc/passwd")),
    "a recipe with a folder that is a path": Recipe(
        _target(object_set="../../x", folder_sha256="../../../home/docs")
    ),
    "a recipe with a texture that is a path": Recipe(_target(texture="../../../../etc/passwd")),
    "a recipe with an object far away": Recipe(
        lambda p: p["objects"][0]["drop_pose"].update(position=[1e308, -1e308, 1e308])
    ),
    "a recipe with a policy that is a path": Recipe(lambda p: p.update(policy="os.system")),
    "a recipe with deep parameters": Recipe(
        lambda p: p.update(policy_parameters=json.loads("[" * 900 + "]" * 900))
    ),
    "a recipe with 100,000 parameters": Recipe(
        lambda p: p.update(policy_parameters={f"k{i}": i for i in range(100_000)})
    ),
    "a recipe with 500 cameras": Recipe(
        lambda p: p.update(cameras={f"c{i}": next(iter(p["cameras"].values())) for i in range(500)})
    ),
    "a recipe with another camera": Recipe(
        lambda p: p.update(cameras={"other": next(iter(p["cameras"].values()))})
    ),
    "a recipe that is a number": Recipe(lambda p: 7),
    "a recipe that is nested deep": Recipe(lambda p: json.loads("[" * 900 + "]" * 900)),
    "a recipe with escape sequences": Recipe(
        lambda p: p.update(policy=ESCAPE, objects=[{**p["objects"][0], "object_id": ESCAPE}])
    ),
    "a recipe with formulas": Recipe(
        lambda p: p.update(policy=FORMULA, objects=[{**p["objects"][0], "object_id": FORMULA}])
    ),
}
for _name in (
    *("of images of 30000 x 30000", "of images of no size", "of 3,000 objects"),
    *(
        "with 500 cameras",
        "with another camera",
        "with an object far away",
        "with an object that is a path",
    ),
    *("with a texture that is a path", "with escape sequences", "with a seed of 2^70"),
):
    _quarantined = ATTACKS[f"a recipe {_name}"]
    assert isinstance(_quarantined, Recipe)
    ATTACKS[f"a whole row with a recipe {_name}"] = replace(_quarantined, is_quarantined=False)
ATTACKS |= {
    "an error with escape sequences": lambda store, outside: quarantined(
        store, 0, _spec(store), ESCAPE + "\n" + FORMULA
    ),
    "an error with markup": lambda store, outside: quarantined(
        store, 0, _spec(store), "<script>alert(1)</script>[x](javascript:alert(1))|`"
    ),
    "an error of 10 MB": lambda store, outside: quarantined(store, 0, _spec(store), "x" * 10**7),
}


def _spec(store: Path) -> str:
    return str(zarr.open_array(store / "episodes/spec", mode="r")[0])


@attack("an object's name with escape sequences and formulas in a committed row")
def _(store: Path, outside: Path) -> None:
    for name in ("object_id", "object_family"):
        array = zarr.open_array(store / "episodes" / name, mode="r+")
        array[:] = np.array([FORMULA, ESCAPE, "+1", "@x", "-1"] * 2, array.dtype)


@attack("lengths of streams that are far too large")
def _(store: Path, outside: Path) -> None:
    array = zarr.open_array(store / "episodes/n_steps", mode="r+")
    array[:] = np.iinfo(array.dtype).max
