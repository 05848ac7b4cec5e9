"""Hand-built episodes with every array of the store, without physics."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from grasp_factory.core import schema
from grasp_factory.core.appearance import Surroundings
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import Outcome
from grasp_factory.core.episode import CameraFrames, Episode, EpisodeSpec, ObjectSpec
from grasp_factory.core.geometry import Pose
from grasp_factory.core.sensors import series_groups
from grasp_factory.writers.base import Quarantined

JOINTS = 7


def small_config(**more: Any) -> FactoryConfig:
    """Return a config with tiny images, short streams and blocks of 4."""
    defaults = {"resolution": (32, 24), "record_hz": 10, "block_size": 4}
    physics = {"free_hz": 240, "contact_hz": 960}
    return FactoryConfig.from_plain(defaults | {"physics": physics} | more)


def make_spec(config: FactoryConfig, index: int) -> EpisodeSpec:
    """Return the recipe of episode ``index``, the same for the same arguments."""
    rng = np.random.default_rng([config.seed, index, 0])
    target = ObjectSpec(
        object_set="procedural",
        object_id=f"procedural/box/{rng.integers(100)}",
        family="box",
        split=str(rng.choice(["train", "val", "test"])),
        mass=float(rng.uniform(0.05, 0.5)),
        lateral_friction=float(rng.uniform(0.5, 1.0)),
        drop_pose=Pose(tuple(rng.normal(size=3).tolist()), (0.0, 0.0, 0.0, 1.0)),
    )
    others = [
        replace(target, object_id=f"procedural/ring/{i}", family="ring")
        for i in range(1, config.clutter.count)
    ]
    return EpisodeSpec(
        index=index,
        seed=config.seed,
        robot=config.robot,
        policy=str(rng.choice(sorted(config.policies))),
        policy_parameters={},
        objects=(target, *others),
        surroundings=Surroundings(),
        cameras=config.cameras,
        resolution=config.resolution,
        record_hz=config.record_hz,
        imu_hz=config.imu_rate,
        video_hz=config.video_hz,
        workspace=config.workspace,
        physics=config.physics,
        motion=config.motion,
        shake=config.shake,
        label=config.label,
        quality=config.quality,
    )


def make_episode(config: FactoryConfig, index: int, n_steps: int | None = None) -> Episode:
    """Return a random episode, the same for the same arguments.

    It has NaN and both zeros among its floats, and ``n_steps`` records (drawn if not given).
    """
    rng = np.random.default_rng([config.seed, index, 1])
    size = schema.sizes(config, JOINTS)
    spec = make_spec(config, index)
    steps = int(rng.integers(0, size["T"] + 1)) if n_steps is None else n_steps
    columns: dict[str, Any] = {}
    groups = [group for group in series_groups() if group.rate(config)]
    series: dict[str, dict[str, Any]] = {group.name: {} for group in groups}
    lengths = {group.dim: steps * group.rate(config) // config.record_hz for group in groups}
    cameras: dict[str, dict[str, Any]] = {name: {} for name in config.cameras}
    for row in schema.expand(config):
        group, name = row.path.split("/", 1)
        shape = schema.shape(row, size)
        if group in series:
            if row.length_column:
                shape = (lengths[str(row.dims[0])], *shape[1:])
            series[group][name] = _random(rng, row, shape)
        elif group == "cameras":
            camera, name = name.split("/")
            cameras[camera][name] = _calibrated(name, _random(rng, row, shape))
        elif name not in _OWN:
            value = _random(rng, row, shape)
            columns[name] = value if value.ndim else value.item()
    target = spec.objects[0]
    columns["grasp_position"] = _in_the_workspace(config, columns["grasp_position"])
    columns |= {
        "object_id": target.object_id,
        "object_set": target.object_set,
        "object_family": target.family,
        "split": target.split,
        "policy": spec.policy,
        "grasp_proposer": spec.policy,
        "object_mass": target.mass,
        "object_ids": np.array([recipe.object_id for recipe in spec.objects]),
    }
    return Episode(
        spec=spec,
        outcome=Outcome(int(rng.integers(len(Outcome)))),
        columns=columns,
        cameras={name: CameraFrames(**arrays) for name, arrays in cameras.items()},
        streams=series.pop("streams"),
        own_rate=series,
    )


def make_rows(
    config: FactoryConfig, block: int, n: int, quarantined: tuple[int, ...] = ()
) -> list[Episode | Quarantined]:
    """Return the rows of a block of a store with ``n`` episodes."""
    start = block * config.block_size
    return [
        Quarantined(make_spec(config, i), f"no luck with {i}")
        if i in quarantined
        else make_episode(config, i)
        for i in range(start, min(start + config.block_size, n))
    ]


_OWN = (
    *("status", "checksum", "array_crc32c", "success", "outcome", "spec", "error", "seed", "index"),
    *("fingerprint", *(group.count for group in series_groups())),
)


def _in_the_workspace(config: FactoryConfig, values: Any) -> Any:
    """Return positions (3,) near the middle of the workspace."""
    lower, upper = np.array(config.workspace.lower), np.array(config.workspace.upper)
    return (lower + upper) / 2.0 + 0.05 * values


def _calibrated(name: str, values: Any) -> Any:
    """Return values of a camera; its calibration has no holes and positive intrinsics."""
    if name == "intrinsics":
        return np.abs(np.nan_to_num(values)) + 1.0
    return np.nan_to_num(values) if name == "T_world_camera" else values


def _random(rng: np.random.Generator, row: schema.Field, shape: tuple[int, ...]) -> Any:
    if row.dtype == "string":
        return np.full(shape, "")
    dtype = np.dtype(row.dtype)
    if dtype.kind == "f":
        values = rng.normal(size=shape).astype(dtype)
        holes = rng.random(shape)
        return np.where(holes < 0.1, np.nan, np.where(holes < 0.2, -0.0, values)).astype(dtype)
    if dtype.kind == "b":
        return rng.random(shape) < 0.5
    return rng.integers(0, len(row.names) or 256, size=shape, dtype=dtype)
