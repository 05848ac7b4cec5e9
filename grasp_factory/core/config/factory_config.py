"""The config of a dataset: one frozen, validated record, read from YAML and kept in the store."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

from grasp_factory.core.config.cameras import CAMERAS, CameraConfig
from grasp_factory.core.config.capture import CaptureConfig
from grasp_factory.core.config.label import LabelConfig
from grasp_factory.core.config.motion import MotionConfig
from grasp_factory.core.config.physics import PhysicsConfig
from grasp_factory.core.config.plugin_origin import PluginOrigin, check_plugins, plain_plugins
from grasp_factory.core.config.quality import QualityConfig
from grasp_factory.core.config.randomization import RandomizeConfig
from grasp_factory.core.config.recording import (
    IMU_HZ,
    RECORD_HZ,
    SIDES,
    VIDEO_HZ,
    check_divides,
    check_name,
    check_recording,
)
from grasp_factory.core.config.scene import ClutterConfig, WorkspaceConfig
from grasp_factory.core.config.sensor_array import SensorArray, check_sensors, plain_sensors
from grasp_factory.core.config.shake import SHAKE_MOTIONS, ShakeConfig
from grasp_factory.core.config.within import Valid, Within, check_within
from grasp_factory.core.enums import Phase
from grasp_factory.core.json_text import check_depth
from grasp_factory.core.renderer import Renderer
from grasp_factory.core.sensors import series_groups
from grasp_factory.core.serialization import (
    check,
    from_plain,
    is_integer,
    is_number,
    normalise,
    to_plain,
)
from grasp_factory.core.splits import SPLITS
from grasp_factory.errors import ConfigError

_SPLITS = f"some of {', '.join(SPLITS)}, each once"
_WEIGHTS = "names with weights >= 0, at least one above 0"
MAX_VIDEO_GB = 4
"""Largest memory for the videos of a block in each worker, in GB (10^9 bytes)."""


def _check_weights(key: str, weights: Mapping[str, float]) -> None:
    ok = all(weight >= 0.0 for weight in weights.values()) and 0.0 < sum(weights.values())
    check(ok, key, dict(weights), _WEIGHTS)
    ok = math.isfinite(sum(weights.values()))
    check(ok, key, dict(weights), "weights whose sum is a finite number")


def _settled(value: Any) -> Any:
    """Return plain data such that equal data has equal JSON: 1.0 and 1 both become 1."""
    if isinstance(value, Mapping):
        return {str(key): _settled(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_settled(item) for item in value]
    if is_integer(value):
        return int(value)
    if is_number(value):
        number = float(value)
        return int(number) if number.is_integer() and abs(number) < 2**53 else number
    return value


@dataclass(frozen=True, slots=True, kw_only=True)
class FactoryConfig:
    """All settings that determine the content of a dataset, except the number of episodes."""

    seed: Annotated[int, Within(0, 2**63 - 1)] = 0
    """Seed of all random draws."""
    robot: str = "kuka_iiwa"
    """Name of the robot; ``grasp-factory robots`` lists them."""
    policies: Annotated[Mapping[str, float], Valid(_WEIGHTS)] = field(
        default_factory=lambda: {"uniform": 3.0, "top_down": 1.0}
    )
    """Policy name to weight; one policy is drawn for each episode.

    With the default about as many grasps succeed as fail.
    """
    policy_parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Policy name to the settings of that policy; missing keys take the policy's defaults."""
    object_sets: Annotated[Mapping[str, float], Valid(_WEIGHTS)] = field(
        default_factory=lambda: {"procedural": 0.5, "blobs": 0.4, "classic": 0.1}
    )
    """Object set name to weight: each object is drawn from one of them."""
    object_folders: Mapping[str, str] = field(default_factory=dict)
    """User's object set to the SHA-256 of its contents (``grasp-factory objects DIR``)."""
    object_splits: Annotated[tuple[str, ...], Valid(_SPLITS)] = SPLITS
    """Objects are drawn from these splits only."""
    clutter: ClutterConfig = field(default_factory=ClutterConfig)
    """The number of objects, and where they fall; or the number alone."""
    cameras: Mapping[str, CameraConfig] = field(
        default_factory=lambda: {"front": CAMERAS["front"].config}
    )
    """Cameras by name; or a list of names that ``grasp-factory cameras`` lists."""
    resolution: Annotated[tuple[int, int], Valid(SIDES)] = (640, 480)
    """Image width and height, pixels."""
    renderer: Renderer = Renderer.TINY
    """The renderer of the images: tiny, or egl where OpenGL is available."""
    record_hz: Annotated[int, RECORD_HZ] = 120
    """Rate of the streams, Hz; a divisor of both physics rates."""
    imu_hz: Annotated[int, IMU_HZ] = 400
    """Requested rate of the IMU, Hz; ``imu_rate`` is the nearest rate that fits the other rates."""
    video_hz: Annotated[int, VIDEO_HZ] = 0
    """Frame rate of each camera's video of the attempt, Hz; a divisor of both physics rates.

    0 for no video.
    """
    block_size: Annotated[int, Within(1, 1024)] = 8
    """Number of episodes in a block; one process generates and commits a block."""
    workspace: WorkspaceConfig = field(default_factory=WorkspaceConfig)
    """The box on the table in which objects are dropped and may be grasped."""
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)
    """The simulator's rates and solver; or a preset: default, fast."""
    motion: MotionConfig = field(default_factory=MotionConfig)
    """Distances, speeds and grip force of an attempt."""
    shake: ShakeConfig = field(default_factory=ShakeConfig)
    """The shake after the hold."""
    label: LabelConfig = field(default_factory=LabelConfig)
    """Thresholds of the success label."""
    quality: QualityConfig = field(default_factory=QualityConfig)
    """Thresholds of the quality score."""
    randomize: RandomizeConfig = field(default_factory=RandomizeConfig)
    """Ranges that are drawn from; or a preset: none, looks, light, strong."""
    capture: CaptureConfig | None = None
    """Room for real episodes; without it, a store holds simulated ones alone."""
    sensors: Mapping[str, tuple[SensorArray, ...]] = field(default_factory=dict)
    """Sensors of a plugin, which record beside those of this package; or a list of FILE.py:NAME.

    ``factory.plugins.with_plugins`` fills in the arrays of each.
    """

    plugins: Mapping[str, Mapping[str, PluginOrigin]] = field(default_factory=dict)
    """Policies, robots, object sets and sensors that are not of this package, by kind and name.

    ``factory.plugins.with_plugins`` fills it.
    """

    def __post_init__(self) -> None:
        try:
            normalise(self)
            object.__setattr__(self, "policy_parameters", _settled(self.policy_parameters))
        except RecursionError:
            raise ConfigError("config: it is nested too deeply; valid: a few levels") from None
        check_within(self)
        _check_weights("policies", self.policies)
        _check_weights("object_sets", self.object_sets)
        for key, embedded in (("object_folders", self.object_folders), ("models", self.models)):
            for name in embedded:
                check_name(key, name)
        used: dict[str, Collection[str]] = {
            "policies": self.policies,
            "object_sets": self.object_sets,
        }
        used |= {"robots": (self.robot,), "sensors": self.sensors}
        check_plugins(self.plugins, used)
        check_sensors(self.sensors)
        self._check_splits()
        self._check_resolution()
        self._check_textures()
        if self.video_hz:
            self._check_video()
        for group in (group for group in series_groups() if not group.is_real):
            check_divides(self.physics, f"rate of {group.name}", group.rate(self) or 1)
        self._check_randomize()
        valid = f"less than motion.lift_height ({self.motion.lift_height})"
        lift = self.label.min_lift
        check(lift < self.motion.lift_height, "label.min_lift", lift, valid)
        strongest = max(self.shake.levels, default=0.0)
        valid = f"at most the last of shake.levels ({strongest})"
        check(self.label.min_shake <= strongest, "label.min_shake", self.label.min_shake, valid)

    def _check_splits(self) -> None:
        """Check the splits and sort them, because their order has no meaning."""
        got = self.object_splits
        ok = 0 < len(got) == len(set(got)) and set(got) <= set(SPLITS)
        check(ok, "object_splits", list(got), _SPLITS)
        ordered = tuple(split for split in SPLITS if split in got)
        object.__setattr__(self, "object_splits", ordered)

    def _check_resolution(self) -> None:
        check_recording(self)
        (width, height), name = self.renderer.largest_image, self.renderer.value
        fits = self.resolution[0] <= width and self.resolution[1] <= height
        valid = f"up to {width}x{height} with renderer {name}"
        check(fits, "resolution", list(self.resolution), valid)

    def _check_textures(self) -> None:
        for key in ("object_texture", "table_texture", "floor_texture"):
            share = getattr(self.randomize.looks, key)
            ok = share == 0.0 or self.renderer.has_textures
            valid = f"0 with renderer {self.renderer.value}, which shows no textures"
            check(ok, f"randomize.looks.{key}", share, valid)

    def _check_video(self) -> None:
        """Check that the videos of a block fit into memory: a block is written as a whole."""
        width, height = self.resolution
        frames = self.longest_video * self.block_size * len(self.cameras)
        size = frames * width * height * 3 / 1e9
        valid = (
            f"less: a block's videos would take up to {size:.0f} GB of memory, valid: up to"
            f" {MAX_VIDEO_GB}; a smaller block_size or resolution helps too"
        )
        check(size <= MAX_VIDEO_GB, "video_hz", self.video_hz, valid)

    def _check_randomize(self) -> None:
        """Check that every value in the ranges of ``randomize`` gives a valid motion and camera."""
        gripper, jitter = self.randomize.gripper, self.randomize.cameras.fov_y_deg
        for force, speed in itertools.product(gripper.force, gripper.speed):
            try:
                self.motion.scaled(force, speed)
            except ConfigError as error:
                raise ConfigError(f"randomize.gripper: with motion.{error}") from None
        for name, camera in self.cameras.items():
            angle = camera.fov_y_deg
            ok = 1.0 <= angle - jitter and angle + jitter <= 170.0
            valid = f"such that cameras.{name}.fov_y_deg ({angle}) stays within 1 to 170 degrees"
            check(ok, "randomize.cameras.fov_y_deg", jitter, valid)

    @property
    def models(self) -> dict[str, str]:
        """SHA-256 of the trained model of each policy that has one, by policy name.

        It is the policy's setting ``model``.
        """
        settings = {name: self.policy_parameters.get(name, {}) for name in self.policies}
        return {name: str(own["model"]) for name, own in settings.items() if own.get("model")}

    @property
    def imu_rate(self) -> int:
        """Rate of the IMU, Hz: a divisor of both physics rates and a multiple of ``record_hz``."""
        whole = math.gcd(self.physics.free_hz, self.physics.contact_hz)
        rates = [r for r in range(self.record_hz, whole + 1, self.record_hz) if whole % r == 0]
        return min(rates, key=lambda rate: abs(rate - self.imu_hz))

    @property
    def longest_s(self) -> float:
        """Upper bound for the duration of an attempt, seconds."""
        # Each motion may be rounded up to the control rate.
        motions = len(Phase) + SHAKE_MOTIONS * len(self.shake.levels)
        rounding = motions / self.physics.control_hz
        slowest = self.motion.scaled(1.0, self.randomize.gripper.speed[0])
        simulated = slowest.longest_s + self.shake.longest_s(self.physics.control_hz) + rounding
        return max(simulated, self.capture.longest_s) if self.capture else simulated

    @property
    def longest_attempt(self) -> int:
        """Upper bound for the number of records of an attempt."""
        return math.ceil(self.longest_s * self.record_hz)

    @property
    def longest_video(self) -> int:
        """Upper bound for the number of video frames of an attempt."""
        return math.ceil(self.longest_s * self.video_hz)

    @classmethod
    def from_plain(cls, data: Any) -> FactoryConfig:
        """Build a config from nested dicts, lists and scalars.

        Raises:
            ConfigError: naming the key, what it got and what is valid.
        """
        check_depth("config", data)
        return from_plain(cls, data)

    def to_plain(self) -> dict[str, Any]:
        """Return the config as nested dicts, lists and scalars.

        ``capture``, ``sensors`` and ``plugins`` are left out if it has none. So other configs have
        the same SHA-256 as before these keys were known.
        """
        plain = dict(to_plain(self))
        plugins = plain_plugins(self.plugins)
        if self.capture is None:
            del plain["capture"]
        for key, short in (("sensors", plain_sensors(self.sensors)), ("plugins", plugins)):
            if short:
                plain[key] = short
            else:
                del plain[key]
        return plain

    def sha256(self) -> str:
        """Return the SHA-256 (hex) of the config, which a store keeps to identify its config."""
        text = json.dumps(self.to_plain(), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()
