"""What a dataset is made from: one frozen, validated record that YAML feeds and the store keeps."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml

from grasp_factory.errors import ConfigError
from grasp_factory.records import check, check_range, from_plain, to_plain
from grasp_factory.sections import (
    CameraConfig,
    LabelConfig,
    MotionConfig,
    PhysicsConfig,
    WorkspaceConfig,
)


def _check_weights(key: str, weights: Mapping[str, float]) -> None:
    ok = len(weights) > 0 and all(w >= 0.0 for w in weights.values()) and sum(weights.values()) > 0
    check(ok, key, dict(weights), "names with weights >= 0, at least one above 0")


DEFAULT_CAMERAS = MappingProxyType(
    {"front": CameraConfig(eye=(1.15, 0.0, 0.58), target=(0.52, 0.0, 0.10), fov_y_deg=36.0)}
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FactoryConfig:
    """Everything that decides the content of a dataset, apart from how many episodes it has."""

    seed: int = 0
    robot: str = "kuka_iiwa"
    policies: Mapping[str, float] = field(default_factory=lambda: {"uniform": 3.0, "top_down": 2.0})
    """Policy name to weight: each episode draws one. The default gives about even classes."""
    policy_parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Policy name to settings of its own; what is left out takes the policy's default."""
    object_sets: Mapping[str, float] = field(default_factory=lambda: {"blobs": 0.8, "classic": 0.2})
    """Object set name to weight: each episode draws one."""
    cameras: Mapping[str, CameraConfig] = field(default_factory=lambda: dict(DEFAULT_CAMERAS))
    resolution: tuple[int, int] = (640, 480)
    """Image width and height, pixels."""
    record_hz: int = 120
    """Rate of the streams; divides both physics rates."""
    block_size: int = 8
    """Episodes that one process makes and commits together."""
    workspace: WorkspaceConfig = field(default_factory=WorkspaceConfig)
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    label: LabelConfig = field(default_factory=LabelConfig)

    def __post_init__(self) -> None:
        check_range(self, "seed", 0, 2**63 - 1)
        check_range(self, "block_size", 1, 1024)
        check_range(self, "record_hz", 1, 10_000, "Hz")
        _check_weights("policies", self.policies)
        _check_weights("object_sets", self.object_sets)
        check(len(self.cameras) > 0, "cameras", {}, "at least one camera")
        for name in self.cameras:
            check(name.isidentifier(), "cameras", name, "names of letters, digits and _")
        sides = [16 <= side <= 4096 for side in self.resolution]
        check(all(sides), "resolution", list(self.resolution), "16 to 4096 pixels a side")
        for name in ("free_hz", "contact_hz"):
            rate = getattr(self.physics, name)
            valid = f"a divisor of physics.{name} ({rate})"
            check(rate % self.record_hz == 0, "record_hz", self.record_hz, valid)
        valid = f"less than motion.lift_height ({self.motion.lift_height})"
        lift = self.label.min_lift
        check(lift < self.motion.lift_height, "label.min_lift", lift, valid)

    @classmethod
    def from_plain(cls, data: Any) -> FactoryConfig:
        """Build a config from nested dicts, lists and scalars.

        Raises:
            ConfigError: naming the key, what it got and what is valid.
        """
        return from_plain(cls, data)

    def to_plain(self) -> dict[str, Any]:
        """Return the config as nested dicts, lists and scalars."""
        return dict(to_plain(self))

    def sha256(self) -> str:
        """Return the hash that a store is recognised by."""
        text = json.dumps(self.to_plain(), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()


def read_yaml(path: Path) -> dict[str, Any]:
    """Return the mapping that a YAML file holds.

    Raises:
        ConfigError: if the file cannot be read, is no YAML, or holds no mapping.
    """
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"config file {path} cannot be read: {error}") from None
    except yaml.MarkedYAMLError as error:
        line = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        raise ConfigError(f"config file {path} is not valid YAML: {line}{error.problem}") from None
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        first = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ConfigError(f"config file {path} is not valid YAML: {first}") from None
    if data is None:
        return {}
    if not isinstance(data, dict):
        raise ConfigError(f"config file {path}: expected a mapping of keys, got {data!r:.80}")
    return data


def first_difference(a: Any, b: Any, where: str = "") -> str | None:
    """Return ``key: a's value against b's`` for the first difference of two plain configs."""
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        for key in [*a, *(k for k in b if k not in a)]:
            here = f"{where}.{key}" if where else str(key)
            if key not in a or key not in b:
                return f"{here}: {a.get(key, 'absent')!r} against {b.get(key, 'absent')!r}"
            found = first_difference(a[key], b[key], here)
            if found:
                return found
        return None
    return None if a == b else f"{where}: {a!r} against {b!r}"
