"""``objects.yaml``: a user's settings for the objects of a folder."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from grasp_factory.core.config.yaml_loader import parse_yaml
from grasp_factory.core.serialization import check, check_range, from_plain
from grasp_factory.errors import ConfigError, did_you_mean, shown

DENSITY = 500.0
"""kg/m3, if neither mass nor density is stated: household objects are partly air, like softwood."""
MASS_RANGE = (0.02, 1.0)
"""kg. A mass computed from ``DENSITY`` is clamped to it: a guess should be plausible."""
MAX_TEXT = 2**20
"""Bytes of the file."""
FRICTION = 0.5
"""Bullet's default, typical of a dry contact; the shipped objects have it too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """The settings of an object; None where nothing is set."""

    mass: float | None = None
    """kg."""
    density: float | None = None
    """kg/m3."""
    friction: float | None = None
    """Lateral friction coefficient against the fingers."""
    scale: float | None = None
    """Metres per unit of a mesh; a factor for a URDF."""
    skip: bool = False

    def __post_init__(self) -> None:
        ranges = {
            "mass": (0.001, 5.0, "kg"),
            "density": (5.0, 25_000.0, "kg/m3"),
            "friction": (0.01, 3.0, ""),
            "scale": (1e-9, 1e6, ""),
        }
        for key, (low, high, unit) in ranges.items():
            if getattr(self, key) is not None:
                check_range(self, key, low, high, unit)
        both = None not in (self.mass, self.density)
        check(not both, "mass", self.mass, "only one of mass and density")


@dataclass(frozen=True, slots=True, kw_only=True)
class FolderSettings:
    """The content of ``objects.yaml``."""

    defaults: Settings = field(default_factory=Settings)
    """For objects without their own setting."""
    objects: Mapping[str, Settings] = field(default_factory=dict)
    """By path in the folder."""

    def __post_init__(self) -> None:
        check(not self.defaults.skip, "defaults.skip", True, "said of single files only")

    def of(self, file: str) -> Settings:
        """Return the settings of one file, without the defaults."""
        return self.objects.get(file, Settings())

    def check_files(self, files: Iterable[str], where: str) -> None:
        """Refuse settings for files that do not exist.

        Raises:
            ConfigError: naming the nearest file.
        """
        valid = set(files)
        for file in self.objects:
            if file not in valid:
                raise ConfigError(
                    f"{where}: objects: there is no file {shown(file)}{did_you_mean(file, valid)}"
                )


def parse_settings(data: bytes, where: str) -> FolderSettings:
    """Return the settings that a file's content states.

    Raises:
        ConfigError: naming the key, what it got and what is valid.
    """
    if len(data) > MAX_TEXT:
        raise ConfigError(f"{where} has more than {MAX_TEXT // 2**20} MiB")
    try:
        plain: Any = parse_yaml(data.decode("utf-8-sig"), where)
    except UnicodeDecodeError:
        raise ConfigError(f"{where} is not UTF-8 text") from None
    try:
        return from_plain(FolderSettings, _without_blanks(plain))
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None


def _without_blanks(plain: Any) -> Any:
    """Return a file's data without the keys that have no value."""
    if plain is None:
        return {}
    if not isinstance(plain, dict):
        return plain
    return {key: value for key, value in plain.items() if value is not None}
