"""The options that describe a dataset, for every command that makes episodes or scenes."""

# ruff: noqa: PLC0415

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import click

from grasp_factory.cli.params import resolution, weighted
from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.physics import PHYSICS_PRESETS
from grasp_factory.core.config.randomization import RANDOMIZE_PRESETS
from grasp_factory.core.config.yaml_loader import read_yaml
from grasp_factory.core.platforms import ACCEPT
from grasp_factory.core.renderer import Renderer
from grasp_factory.core.serialization import check
from grasp_factory.core.splits import SPLITS
from grasp_factory.errors import UsageError, shown
from grasp_factory.factory.run_request import Request, resolve_request

F = TypeVar("F", bound=Callable[..., Any])

REQUEST = Request(config=FactoryConfig())
DEFAULTS = REQUEST.config
_LEARNED = "learned"
_SIZE = "x".join(str(side) for side in DEFAULTS.resolution)

_OPTIONS = (
    click.option(
        "--seed", type=int, help=f"What all chance follows from.  [default: {DEFAULTS.seed}]"
    ),
    click.option("--robot", help=f"One of `grasp-factory robots`.  [default: {DEFAULTS.robot}]"),
    click.option(
        "--policy",
        "policies",
        type=weighted,
        metavar="NAME[:WEIGHT]",
        multiple=True,
        help="One of `grasp-factory policies`, with the weight of its share; repeatable.",
    ),
    click.option(
        "--model",
        type=click.Path(path_type=Path),
        help="File of the trained model that the policy learned ranks its grasps by.",
    ),
    click.option(
        "--objects",
        "object_sets",
        type=weighted,
        metavar="NAME|DIR[:WEIGHT]",
        multiple=True,
        help="One of `grasp-factory objects`, or a folder of meshes and URDFs, with the weight of"
        " its share; repeatable.",
    ),
    click.option(
        "--split",
        "object_splits",
        type=click.Choice(SPLITS),
        multiple=True,
        help="Drop objects of this split only; repeatable.  [default: all]",
    ),
    click.option(
        "--clutter",
        type=int,
        help="Objects that fall together; one of them is the target.  [default: 1]",
    ),
    click.option(
        "--camera",
        "cameras",
        type=click.Choice(sorted(CAMERAS)),
        multiple=True,
        help="What to look with; repeatable.  [default: front]",
    ),
    click.option(
        "--resolution",
        type=resolution,
        metavar="WxH",
        help=f"Of all images, pixels.  [default: {_SIZE}]",
    ),
    click.option(
        "--renderer",
        type=click.Choice([renderer.value for renderer in Renderer]),
        help="tiny needs no driver and is reproducible; egl needs OpenGL, of a GPU or Mesa."
        f"  [default: {DEFAULTS.renderer.value}]",
    ),
    click.option(
        "--randomize",
        type=click.Choice(sorted(RANDOMIZE_PRESETS)),
        help="Domain randomisation: of looks alone, or of looks, cameras, bodies and grip, light"
        " or strong.  [default: none]",
    ),
    click.option(
        "--physics",
        type=click.Choice(sorted(PHYSICS_PRESETS)),
        help="fast saves a quarter of the time; labels flatter by a point or two."
        "  [default: default]",
    ),
    click.option("--record-hz", type=int, help=f"Of the streams.  [default: {DEFAULTS.record_hz}]"),
    click.option(
        "--video-hz",
        type=int,
        help="Of a video of each attempt, for every camera.  [default: none]",
    ),
    click.option(
        "--set",
        "assignments",
        metavar="KEY=VALUE",
        multiple=True,
        help="Any config key, dotted, with a YAML value, such as motion.grip_force=30.",
    ),
    click.option(
        "--config",
        "file",
        type=click.Path(path_type=Path),
        help="YAML file with any of these settings; options win over it.",
    ),
)

_RUN_OPTIONS = (
    click.option(
        "--n", type=int, help=f"Episodes that the store shall have.  [default: {REQUEST.n}]"
    ),
    click.option("--workers", type=int, help=f"Processes.  [default: {REQUEST.workers}]"),
    click.option("--out", type=click.Path(), help=f"The store.  [default: {REQUEST.out}]"),
    click.option(
        "--shard",
        metavar="I/K",
        help="Make the I-th of K parts; other runs may make the others, into the same store, at the"
        " same time.",
    ),
    click.option(
        "--episode-timeout",
        type=float,
        help="Seconds after which an episode's worker is ended; 0 for never."
        f"  [default: {REQUEST.episode_timeout:g}]",
    ),
    click.option(
        "--max-failures",
        type=float,
        help="Share of quarantined episodes above which to exit with 1."
        f"  [default: {REQUEST.max_failures:g}]",
    ),
    click.option(
        "--retry-quarantined",
        is_flag=True,
        default=None,
        help="Try episodes again that are in quarantine.",
    ),
    click.option(
        ACCEPT,
        is_flag=True,
        default=None,
        help="Go on with a store that was begun on another platform, where bytes may differ.",
    ),
)

_LIVE_OPTIONS = (
    click.option(
        "--live", is_flag=True, help="Serve a page meanwhile that shows progress and alarms."
    ),
    click.option(
        "--live-port",
        type=click.IntRange(1, 65535),
        help="Where --live listens.  [default: 8642, or the next one that is free]",
    ),
)


def run_options(command: F) -> F:
    """Add the options that say how much is made, where to and how; see ``dataset_options``."""
    for option in reversed(_RUN_OPTIONS):
        command = option(command)
    return command


def live_options(command: F) -> F:
    """Add the options of the live view; see ``check_live``."""
    for option in reversed(_LIVE_OPTIONS):
        command = option(command)
    return command


def check_live(*, live: bool, live_port: int | None, makes_something: bool) -> None:
    """Check the options of the live view.

    Raises:
        UsageError: for a port without a view, or a view of a run that makes nothing.
    """
    if live_port is not None and not live:
        raise UsageError("--live-port is for the live view: add --live")
    if live and not makes_something:
        raise UsageError("--live shows episodes being made: leave out --dry-run and --print-config")


def dataset_options(command: F) -> F:
    """Add the options to a command; it hands them to ``request_from`` as they come."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def request_from(
    *, file: Path | None, assignments: tuple[str, ...], model: Path | None, **flags: Any
) -> Request:
    """Return the checked request that options describe; folders and models are imported.

    Raises:
        UsageError: for a folder in which no object can be used, or a file that is no model.
        ConfigError: naming the key, what it got and what is valid.
    """
    settings = {key: value for key, value in flags.items() if value not in (None, ())}
    for key, option in (("policies", "--policy"), ("object_sets", "--objects")):
        if key in settings:
            settings[key] = _once_each(option, settings[key])
    for key in ("cameras", "object_splits"):
        if key in settings:
            settings[key] = list(settings[key])
    written = read_yaml(file) if file else {}
    folders = [name for name in settings.get("object_sets", {}) if _is_folder(name)]
    if folders:
        weights = settings.pop("object_sets")
        robot = resolve_request(written, settings, assignments).config.robot
        digests = _import(folders, robot)
        names = {text: name for text, (name, _) in digests.items()}
        settings["object_sets"] = {names.get(t, t): weight for t, weight in weights.items()}
        settings["object_folders"] = dict(digests.values())
    request = resolve_request(written, settings, assignments)
    return request if model is None else _with_model(request, model)


def _with_model(request: Request, file: Path) -> Request:
    """Return a request for what the policy ``learned`` does with a model, which is imported."""
    from grasp_factory.policies.model_registry import import_model

    config = request.config
    if _LEARNED not in config.policies:
        raise UsageError(f"--model is for the policy {_LEARNED}: add --policy {_LEARNED}")
    own = {**config.policy_parameters.get(_LEARNED, {}), "model": import_model(file)}
    parameters = {**config.policy_parameters, _LEARNED: own}
    return replace(request, config=replace(config, policy_parameters=parameters))


def _once_each(option: str, pairs: Sequence[tuple[str, float]]) -> dict[str, float]:
    weights = dict(pairs)
    for name in weights:
        check([n for n, _ in pairs].count(name) == 1, option, name, "each name once")
    return weights


def _import(folders: Sequence[str], robot: str) -> dict[str, tuple[str, str]]:
    """Import folders and return each one's set name and digest."""
    from grasp_factory.cli.object_import import import_usable

    found: dict[str, tuple[str, str]] = {}
    places: dict[str, str] = {}
    for folder in sorted(folders, key=os.path.realpath):  # names must not hang on their order
        same = places.setdefault(os.path.realpath(folder), folder)
        if same != folder:
            raise UsageError(f"one folder is given twice: {shown(same)} and {shown(folder)}")
        report = import_usable(Path(folder), robot, [name for name, _ in found.values()])
        found[folder] = report.name, report.sha256
    return found


def _is_folder(name: str) -> bool:
    from grasp_factory.objects import OBJECT_SETS

    return name not in OBJECT_SETS and ("/" in name or os.path.isdir(name))
