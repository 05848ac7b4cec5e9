"""Texts, lengths, clocks and attributes that are of another kind than a run writes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from support.hostile.recipes import Recipe
from support.hostile.table import ATTACKS, ESCAPE, Attack, attack, configured, edited, remove
from support.hostile.values import filled

MARKUP = f"<img src=x onerror=alert(1)>\n# | `[a](javascript:b)` {ESCAPE}\u202e\ud800"
"""What a card must not pass on: markup, a line break, escape sequences, half a character."""


def told(**attributes: Any) -> Attack:
    """Change attributes of the root."""
    return edited("", lambda document: document["attributes"].update(attributes))


def described(**attributes: Any) -> Attack:
    """Change attributes of every array and group below the root."""

    def describe(store: Path, outside: Path) -> None:
        for file in store.rglob("zarr.json"):
            if file.parent != store:
                name = str(file.parent.relative_to(store))
                edited(name, lambda d: d["attributes"].update(attributes))(store, outside)

    return describe


def together(*attacks: Attack) -> Attack:
    """Do several attacks on one store."""

    def do(store: Path, outside: Path) -> None:
        for each in attacks:
            each(store, outside)

    return do


def labelled(*thresholds: Any) -> Attack:
    """Change the thresholds of the added label, or remove them."""

    def change(document: dict[str, Any]) -> None:
        document["attributes"].pop("thresholds")
        if thresholds:
            document["attributes"]["thresholds"] = thresholds[0]

    names = ("", "/outcome", "/success")
    return together(*(edited(f"labels/gentle{name}", change) for name in names))


def nested(depth: int) -> Any:
    """Return lists in lists."""
    value: Any = []
    for _ in range(depth):
        value = [value]
    return value


def _every_text(value: Any) -> Any:
    """Return JSON data with all its texts replaced, but with its keys."""
    if isinstance(value, Mapping):
        return {key: _every_text(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_every_text(item) for item in value]
    return MARKUP if isinstance(value, str) else value


def _every_attribute(document: dict[str, Any]) -> None:
    attributes = document["attributes"]
    kept = ("format", "config", "config_sha256", "metadata_sha256", "arrays", "values_sha256")
    attributes |= {k: _every_text(v) for k, v in attributes.items() if k not in kept}
    attributes |= {"description": MARKUP, "names": [MARKUP] * 20, "units": MARKUP, MARKUP: MARKUP}


@attack("every text of it is markup with escape sequences")
def every_text(store: Path, outside: Path) -> None:
    """Replace every text that a store may choose."""
    for file in list(store.rglob("zarr.json")):
        name = str(file.parent.relative_to(store)) if file.parent != store else ""
        edited(name, _every_attribute)(store, outside)
    remove(store / "packed")
    for name in ("object_id", "object_set", "object_family", "policy", "fingerprint", "error"):
        column = zarr.open_array(store / f"episodes/{name}", mode="r+")
        column[:] = np.full(column.shape, MARKUP.replace("\ud800", ""), "T")


ATTACKS |= {
    "an object with a name of half a character": Recipe(
        lambda plain: plain["objects"][0].update(object_id="a\ud800b"), is_quarantined=False
    ),
    "an object with a name of 100,000 letters": Recipe(
        lambda plain: plain["objects"][0].update(object_id="x" * 100_000), is_quarantined=False
    ),
    "a robot of markup": configured(robot=MARKUP),
    "a recipe and a config with a robot of markup": together(
        Recipe(lambda plain: plain.update(robot=MARKUP), is_quarantined=False),
        configured(robot=MARKUP),
    ),
    "a config with policies of markup": configured(
        policies={MARKUP: 1.0}, policy_parameters={MARKUP: {"model": MARKUP}}
    ),
    "a config with object sets of markup": configured(
        object_sets={MARKUP: 1.0}, object_folders={MARKUP: MARKUP}
    ),
    "created_by with markup": told(created_by=MARKUP),
    "versions with markup": told(versions={MARKUP: MARKUP}, platform={MARKUP: MARKUP}),
    "units with markup": described(units=MARKUP, description=MARKUP),
    "units that are a mapping": described(units={"a": [1]}),
}  # fmt: skip

for _name in ("n_steps", "n_imu", "n_video"):
    for _length in (-5, 2**31 - 1):
        ATTACKS[f"all of episodes/{_name} is {_length}"] = filled(f"episodes/{_name}", _length)
for _path in ("videos/timestamp", "imu/timestamp"):
    for _time in (np.nan, 1e300, -1e300, np.inf):
        ATTACKS[f"each of {_path} is {_time}"] = filled(_path, _time)
for _size in (
    [0, 0], [1e308, 1e308], "x", "12", [1, 2, 3], {}, [1e-9, 1.0], [0.02, float("nan")],
    [0.02, 10**400], [True, True], None, 7, [0.001, 1.0],
):  # fmt: skip
    ATTACKS[f"pads of size {_size!r:.40}"] = told(robot={"pad_size": _size})
for _robot in ([1], "x", 7, None):
    ATTACKS[f"the attribute robot is {_robot!r}"] = told(robot=_robot)
for _thresholds in (7, None, [1], "x", {"a": "x"}, {"a": 10**400}, {"a": [1]}, {MARKUP: 1.0}):
    ATTACKS[f"thresholds of a label are {_thresholds!r:.20}"] = labelled(_thresholds)
ATTACKS["thresholds of a label are missing"] = labelled()
for _depth in (60, 450, 900):
    ATTACKS |= {
        f"policy_parameters nested {_depth} deep": configured(
            policy_parameters={"uniform": {"a": nested(_depth)}}
        ),
        f"a root attribute nested {_depth} deep": told(more=nested(_depth)),
        f"attributes of arrays nested {_depth} deep": together(
            *(
                edited(name, lambda d, depth=_depth: d["attributes"].update(more=nested(depth)))
                for name in ("episodes/spec", "streams", "labels/gentle", "labels/gentle/outcome")
            )
        ),
        f"a recipe nested {_depth} deep": Recipe(
            lambda plain, depth=_depth: plain.update(policy_parameters={"a": nested(depth)}),
            is_quarantined=False,
        ),
    }  # fmt: skip


def _long_camera(plain: dict[str, Any]) -> None:
    plain["cameras"] = {"x" * 300: next(iter(plain["cameras"].values()))}


@attack("a camera with a name of 300 letters")
def _(store: Path, outside: Path) -> None:
    document = json.loads((store / "zarr.json").read_text())
    cameras = {"x" * 300: next(iter(document["attributes"]["config"]["cameras"].values()))}
    configured(cameras=cameras)(store, outside)
    Recipe(_long_camera, is_quarantined=False)(store, outside)


_LONG = "x" * 300
ATTACKS |= {
    "an object set with a name of 300 letters": configured(
        object_sets={_LONG: 1.0}, object_folders={_LONG: "0" * 64}
    ),
    "a policy with a name of 300 letters": configured(
        policies={_LONG: 1.0}, policy_parameters={_LONG: {"model": "0" * 64}}
    ),
}  # fmt: skip


def _joints(count: int) -> Attack:
    """Store another number of joints than the robot has."""

    def resize(store: Path, outside: Path) -> None:
        remove(store / "packed")
        for name in ("joint_positions", "joint_velocities", "joint_torques"):
            path = f"streams/{name}"
            old = zarr.open_array(store / path, mode="r")
            shape, attributes = (*old.shape[:2], count), old.attrs.asdict()
            remove(store / path)
            zarr.create_array(
                store / path, shape=shape, chunks=(1, *(max(n, 1) for n in shape[1:])),
                dtype=old.dtype, fill_value=0, dimension_names=old.metadata.dimension_names,
                attributes=attributes,
            )  # fmt: skip
            edited(path, lambda document: None)(store, outside)

    return resize


for _count in (0, 1, 9):
    ATTACKS[f"an arm of {_count} joints"] = _joints(_count)


@attack("its own name has escape sequences")
def _(store: Path, outside: Path) -> None:
    hostile = store.with_name("\x9b31m\u202e<img src=x>`.zarr")
    store.rename(hostile)
    store.symlink_to(hostile, target_is_directory=True)
