"""The request of one run: config, number of episodes, output path and number of workers.

Settings come from several places, and later ones override earlier ones: the defaults or the config
of a store, a YAML file, the command's flags, and ``KEY=VALUE`` assignments with dotted keys.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.physics import PHYSICS_PRESETS
from grasp_factory.core.config.randomization import RANDOMIZE_PRESETS
from grasp_factory.core.config.within import Valid, Within, check_within
from grasp_factory.core.object_storage.address import store_path
from grasp_factory.core.serialization import check, is_integer, sections_of, to_plain
from grasp_factory.errors import ConfigError, did_you_mean, lookup, shown

MAX_EPISODES = 1_000_000
MAX_WORKERS = 512
MAX_SHARDS = 10_000
SHARDS = f"I/K with K from 1 to {MAX_SHARDS}"
EPISODE_TIMEOUT_S = 600.0
"""A worker that makes one episode for longer is killed; see ``retry_policy.Losses.silence``."""
MAX_FAILURES = 0.25
EXECUTOR = "local"
OPEN_TABLE = "policy_parameters"
"""A table of tables that may be missing: an assignment may add one, whose keys have defaults."""
RUN_KEYS = (
    *("n", "workers", "executor", "out", "shard", "episode_timeout", "max_failures"),
    *("retry_quarantined", "accept_other_platform"),
)
PLUGIN_KEYS = {
    "policies": "policies",
    "robots": "robot",
    "object_sets": "object_sets",
    "sensors": "sensors",
}
"""The key that names the plugins of a kind, by kind."""
CONFIG_KEYS = tuple(f.name for f in dataclasses.fields(FactoryConfig))
SECTIONS = sections_of(FactoryConfig)
PRESETS: Mapping[str, Mapping[str, Any]] = {
    "physics": PHYSICS_PRESETS,
    "randomize": {name: to_plain(preset) for name, preset in RANDOMIZE_PRESETS.items()},
}
"""Presets by key, then by name: a preset's name may replace a section."""


_HEAD = """\
# Settings of `grasp-factory generate`: for --config FILE, or as grasp-factory.yaml in the current
# folder. Any key may be left out. A comment says what a key means, and which values are valid.
"""


@dataclass(frozen=True, slots=True)
class Shard:
    """One of ``count`` parts of a store, each of which has every ``count``-th block."""

    index: int
    """0 to ``count``; 0 and ``count`` are the same part: job arrays may count from 0 or from 1."""
    count: int
    together: int = 0
    """Rows of a block of this part, if they will be joined to larger ones; 0 for the store's."""

    def __post_init__(self) -> None:
        ok = is_integer(self.count) and 1 <= self.count <= MAX_SHARDS
        check(ok, "shard", str(self), SHARDS)
        ok = is_integer(self.index) and 0 <= self.index <= self.count
        check(ok, "shard", str(self), f"I/K with I from 0 to K ({self.count})")

    def __str__(self) -> str:
        return f"{self.index}/{self.count}"

    def has(self, blocks: Any) -> Any:
        """Return whether blocks, an integer or an array of them, are in this part."""
        return blocks % self.count == self.index % self.count

    @classmethod
    def parse(cls, text: Any) -> Shard:
        """Parse the text I/K.

        Raises:
            ConfigError: if it is something else.
        """
        match = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", text) if isinstance(text, str) else None
        if not match:
            raise ConfigError(f"shard: got {shown(text)}, valid: I/K, such as 1/4")
        return cls(int(match[1]), int(match[2]))


WHOLE = Shard(0, 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """A checked run: ``config`` decides the content, the rest decides how much, where and how."""

    config: FactoryConfig
    n: Annotated[int, Within(1, MAX_EPISODES)] = 50
    """Number of episodes that the store must have."""
    workers: Annotated[int, Within(1, MAX_WORKERS)] = 2
    """Number of worker processes, on each node of a cluster."""
    executor: Annotated[str, Valid("NAME or NAME:ADDRESS, such as local or ray")] = EXECUTOR
    """Where the worker processes are: on this machine, or on the nodes of a cluster."""
    out: Path = Path("grasps.zarr")
    """Path of the store."""
    episode_timeout: Annotated[float, Within(0.0, 1e6, "s")] = EPISODE_TIMEOUT_S
    """Seconds that an episode may take before its worker is ended; 0 for no limit."""
    max_failures: Annotated[float, Within(0.0, 1.0)] = MAX_FAILURES
    """Share of quarantined episodes above which the run counts as failed."""
    shard: Annotated[Shard, Valid(SHARDS)] = WHOLE
    """The part of the store that this run makes."""
    retry_quarantined: bool = False
    """Whether quarantined episodes are tried again."""
    accept_other_platform: bool = False
    """Whether to continue a store that was begun on a platform whose bytes may differ."""

    def __post_init__(self) -> None:
        check(isinstance(self.shard, Shard), "shard", self.shard, "a Shard, as Shard(1, 4)")
        check(isinstance(self.executor, str), "executor", self.executor, "NAME or NAME:ADDRESS")
        if self.executor != EXECUTOR:
            from grasp_factory.core.executors import executor_kind  # noqa: PLC0415 - not for --help

            executor_kind(self.executor)
        for key, highest in (("n", MAX_EPISODES), ("workers", MAX_WORKERS)):
            got = getattr(self, key)
            ok = is_integer(got) and 1 <= got <= highest
            check(ok, key, got, f"an integer from 1 to {highest}")
            object.__setattr__(self, key, int(got))  # JSON cannot hold a numpy integer
        check_within(self)

    def to_yaml(self) -> str:
        """Return the settings as YAML with comments, ready to be a config file."""
        from grasp_factory.core.config.commented_yaml import commented_yaml  # noqa: PLC0415 - slow

        run = {key: getattr(self, key) for key in RUN_KEYS}
        run |= {"out": str(self.out), "shard": str(self.shard)}
        run_lines = commented_yaml(Request, run)
        return f"{_HEAD}\n{run_lines}\n{commented_yaml(FactoryConfig, self.config.to_plain())}"


DEFAULT_RUN = Request(config=FactoryConfig())


def parse_size(text: str) -> list[int]:
    """Return width and height from a text such as 640x480.

    Raises:
        ConfigError: if it is something else.
    """
    match = re.fullmatch(r"([0-9]{1,6})[xX]([0-9]{1,6})", text)
    if not match:
        raise ConfigError(f"{shown(text)}: expected WIDTHxHEIGHT in pixels, such as 640x480")
    return [int(side) for side in match.groups()]


def resolve_request(
    file: Mapping[str, Any],
    flags: Mapping[str, Any],
    assignments: Iterable[str] = (),
    *,
    base: FactoryConfig | None = None,
) -> Request:
    """Merge the settings of a config file, flags and ``KEY=VALUE`` texts over those of a base.

    A section such as ``physics`` is merged key by key; a table of names such as ``policies`` or
    ``cameras`` replaces the default one. A preset's name may replace a section that has presets, a
    list of names may replace ``cameras`` or ``sensors``, and a number may replace ``clutter``.

    Args:
        file: settings of a config file.
        flags: settings of flags.
        assignments: ``KEY=VALUE`` texts.
        base: the config below them; None for the defaults.

    Raises:
        ConfigError: naming the key, what it got and what is valid.
    """
    settings: dict[str, Any] = (base or FactoryConfig()).to_plain()
    plugins = settings.get("plugins")
    for source in (file, flags):
        for key, value in source.items():
            _check_key(str(key))
            _merge(settings, key, value)
    for text in assignments:
        _assign(settings, text)
    if plugins is not None and settings["plugins"] is plugins:
        settings["plugins"] = _used(plugins, settings)
    run = {key: settings.pop(key) for key in RUN_KEYS if key in settings}
    if "out" in run:
        ok = isinstance(run["out"], str | Path) and str(run["out"]) != ""
        check(ok, "out", run["out"], "a path")
        run["out"] = store_path(run["out"])
    if "shard" in run:
        run["shard"] = Shard.parse(run["shard"])
    return Request(config=FactoryConfig.from_plain(settings), **run)


def _used(plugins: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of a base's plugins that the settings still use."""
    names = {kind: settings.get(key, ()) for kind, key in PLUGIN_KEYS.items()}
    used = {
        kind: {name: origin for name, origin in rows.items() if name in _names(names[kind])}
        for kind, rows in plugins.items()
    }
    return {kind: rows for kind, rows in used.items() if rows}


def _names(value: Any) -> Collection[Any]:
    """Return the names in a setting: one, or the keys of a table."""
    return value if isinstance(value, Mapping) else [value]


def _check_key(key: str) -> None:
    valid = (*RUN_KEYS, *CONFIG_KEYS)
    if key not in valid:
        hint = did_you_mean(key, valid)
        raise ConfigError(f"unknown key {shown(key)}{hint} (valid: {', '.join(valid)})")


def _merge(settings: dict[str, Any], key: str, value: Any) -> None:
    """Set a value over the current one; sections are merged key by key, tables are replaced."""
    value = _spelled_out(key, value)
    if key in SECTIONS and isinstance(value, Mapping):
        settings[key] = _merged(SECTIONS[key], settings[key], value)
    else:
        settings[key] = value


def _merged(section: type[Any], under: Mapping[str, Any], over: Mapping[str, Any]) -> Any:
    inner = sections_of(section)
    out = {**under, **over}
    for key in inner.keys() & over.keys():
        if isinstance(over[key], Mapping):
            out[key] = _merged(inner[key], under.get(key, {}), over[key])
    return out


def _spelled_out(key: str, value: Any) -> Any:
    """Return the full form of a short form: a preset's name, names of cameras, a count."""
    if key in PRESETS and isinstance(value, str):
        return lookup(PRESETS[key], f"preset of {key}", value)
    if key == "cameras" and isinstance(value, list | tuple):
        return {str(n): to_plain(lookup(CAMERAS, "camera", str(n)).config) for n in value}
    if key == "sensors" and isinstance(value, list | tuple):
        return {str(name): () for name in value}
    if key == "clutter" and is_integer(value):
        return {"count": value}
    if key == "resolution" and isinstance(value, str):
        return parse_size(value)
    return value


def _assign(settings: dict[str, Any], text: str) -> None:
    from grasp_factory.core.config.yaml_loader import parse_yaml  # noqa: PLC0415

    key, equals, value = text.partition("=")
    path = key.strip().split(".")
    if not equals or not all(path):
        raise ConfigError(f"--set {shown(text)}: expected KEY=VALUE, such as motion.grip_force=30")
    _check_key(path[0])
    parsed = parse_yaml(value, f"--set {shown(text)}: {shown(value)}")
    here = settings
    for depth, part in enumerate(path[:-1], 1):
        inner = here.get(part, {} if path[0] == OPEN_TABLE and depth == 2 else None)
        if not isinstance(inner, dict):
            raise ConfigError(f"--set {shown(text)}: {'.'.join(path[:depth])[:100]} has no keys")
        here[part] = dict(inner)  # a YAML alias may share it with other keys
        here = here[part]
    if len(path) == 1:
        _merge(settings, path[0], parsed)
    else:
        here[path[-1]] = parsed
