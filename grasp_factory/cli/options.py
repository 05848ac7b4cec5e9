"""The options of a run and of its dataset, for all commands that make episodes or scenes."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import click

from grasp_factory.cli.completion import completes, rows_of
from grasp_factory.cli.params import option, options, resolution, weighted
from grasp_factory.cli.plugin_options import plugin_options
from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.config.physics import PHYSICS_PRESETS
from grasp_factory.core.config.randomization import RANDOMIZE_PRESETS
from grasp_factory.core.platforms import ACCEPT
from grasp_factory.core.renderer import Renderer
from grasp_factory.core.splits import SPLITS
from grasp_factory.errors import UsageError
from grasp_factory.factory.run_request import DEFAULT_RUN

DEFAULTS = DEFAULT_RUN.config
_SIZE = "x".join(str(side) for side in DEFAULTS.resolution)


def _shares(weights: Mapping[str, float]) -> str:
    return ", ".join(f"{name}:{weight:g}" for name, weight in weights.items())


_run = partial(option, heading="Run")
_scene = partial(option, heading="Scene")
_policy = partial(option, heading="Grasp policy")
_images = partial(option, heading="Cameras and images")
_recording = partial(option, heading="Recording")
_physics = partial(option, heading="Physics and randomization")
_config = partial(option, heading="Configuration")
_live = partial(option, heading="Live page")

dataset_options = options(
    _scene(
        "--seed",
        metavar="SEED",
        type=int,
        help=f"Seed of all random draws.  [default: {DEFAULTS.seed}]",
    ),
    _scene(
        "--robot",
        metavar="NAME|FILE.py:NAME",
        shell_complete=completes(rows_of("robots"), files=True),
        help="Robot, see `grasp-factory robots`, or a RobotModel in a Python file."
        f"  [default: {DEFAULTS.robot}]",
    ),
    _scene(
        "--objects",
        "object_sets",
        type=weighted,
        metavar="NAME|DIR|FILE.py:NAME[:WEIGHT]",
        shell_complete=completes(rows_of("object_sets"), files=True),
        multiple=True,
        help="Object set, see `grasp-factory objects`, a folder of meshes and URDFs, or an"
        " ObjectSet in a Python file. Objects are drawn from several sets in proportion to their"
        " weights. Repeatable."
        f"  [default: {_shares(DEFAULTS.object_sets)}]",
    ),
    _scene(
        "--split",
        "object_splits",
        type=click.Choice(SPLITS),
        multiple=True,
        help="Use only the objects of this split. Repeatable.  [default: all]",
    ),
    _scene(
        "--clutter",
        metavar="N",
        type=int,
        help="Objects in the scene; one of them is the target.  [default: 1]",
    ),
    _policy(
        "--policy",
        "policies",
        type=weighted,
        metavar="NAME|FILE.py:NAME[:WEIGHT]",
        shell_complete=completes(rows_of("policies"), files=True),
        multiple=True,
        help="Policy, see `grasp-factory policies`, or a function in a Python file. Several"
        " policies share the episodes in proportion to their weights. Repeatable."
        f"  [default: {_shares(DEFAULTS.policies)}]",
    ),
    _policy(
        "--model",
        metavar="FILE",
        type=click.Path(path_type=Path),
        help="Trained model with which the policy `learned` ranks its grasps.",
    ),
    *plugin_options("Grasp policy"),
    _images(
        "--camera",
        "cameras",
        type=click.Choice(sorted(CAMERAS)),
        multiple=True,
        help="Camera, see `grasp-factory cameras`. Repeatable.  [default: front]",
    ),
    _images(
        "--resolution",
        type=resolution,
        metavar="WxH",
        help=f"Width and height of all images, in pixels.  [default: {_SIZE}]",
    ),
    _images(
        "--renderer",
        type=click.Choice([renderer.value for renderer in Renderer]),
        help="Renderer of the images: tiny runs on the CPU and is reproducible; egl uses OpenGL,"
        f" on a GPU or with Mesa.  [default: {DEFAULTS.renderer.value}]",
    ),
    _recording(
        "--record-hz",
        metavar="HZ",
        type=int,
        help=f"Sampling rate of the recorded signals.  [default: {DEFAULTS.record_hz}]",
    ),
    _recording(
        "--video-hz",
        metavar="HZ",
        type=int,
        help="Frame rate of a video of each attempt from every camera.  [default: no video]",
    ),
    _recording(
        "--sensor",
        "sensors",
        metavar="NAME|FILE.py:NAME",
        shell_complete=completes(rows_of("sensors"), files=True),
        multiple=True,
        help="Sensor of an installed package, or a SensorModel in a Python file; it records beside"
        " those that `grasp-factory sensors` lists. Repeatable.",
    ),
    _physics(
        "--physics",
        type=click.Choice(sorted(PHYSICS_PRESETS)),
        help="Physics preset. fast takes a quarter less time, but its success rates are one or two"
        " percentage points too high.  [default: default]",
    ),
    _physics(
        "--randomize",
        type=click.Choice(sorted(RANDOMIZE_PRESETS)),
        help="Domain randomization. looks changes colours, textures and light; light and strong"
        " also change cameras, objects and friction.  [default: none]",
    ),
    _config(
        "--config",
        "file",
        metavar="FILE",
        type=click.Path(path_type=Path),
        help="YAML file with any of these settings; options override it."
        "  [default: grasp-factory.yaml of the current folder, if it is there]",
    ),
    _config(
        "--set",
        "assignments",
        metavar="KEY=VALUE",
        multiple=True,
        help="Set any key of the config to a YAML value, such as motion.grip_force=30. Repeatable.",
    ),
)
"""Adds the options of a dataset; the command passes their values to ``request_from``."""

run_options = options(
    _run(
        "--n",
        type=int,
        metavar="N",
        help=f"Episodes in the store.  [default: those of the store at --out, or {DEFAULT_RUN.n}]",
    ),
    _run(
        "--out",
        type=click.Path(),
        help="Store to make, to complete or to grow. One that is there decides all settings below."
        f"  [default: {DEFAULT_RUN.out}]",
    ),
    _run(
        "--workers",
        metavar="N",
        type=int,
        help=f"Worker processes, on each node of a cluster.  [default: {DEFAULT_RUN.workers}]",
    ),
    _run(
        "--executor",
        metavar="NAME[:ADDRESS]",
        help="Where the workers are: inline, local, or the nodes of a cluster, such as"
        f" ray:HOST:PORT.  [default: {DEFAULT_RUN.executor}]",
    ),
    _run(
        "--shard",
        metavar="I/K",
        help="Make only part I of K. Other runs may make the other parts in the same store at the"
        " same time.",
    ),
    _run(
        "--episode-timeout",
        metavar="SECONDS",
        type=float,
        help="Longest time that an episode may take; 0 for no limit."
        f"  [default: {DEFAULT_RUN.episode_timeout:g}]",
    ),
    _run(
        "--max-failures",
        metavar="SHARE",
        type=float,
        help="Largest share of quarantined episodes; the command exits with 1 above it."
        f"  [default: {DEFAULT_RUN.max_failures:g}]",
    ),
    _run(
        "--retry-quarantined",
        is_flag=True,
        default=None,
        help="Simulate the quarantined episodes again.",
    ),
    _run(
        ACCEPT,
        is_flag=True,
        default=None,
        help="Continue a store that was begun on another platform, where bytes may differ.",
    ),
)
"""Adds the options of a run: how many episodes, where to, and how."""

live_options = options(
    _live("--live", is_flag=True, help="Serve a page with progress and alarms during the run."),
    _live(
        "--live-port",
        metavar="PORT",
        type=click.IntRange(1, 65535),
        help="Port of the page.  [default: 8642, or the next free port]",
    ),
)
"""Adds the options of the live page; see ``check_live``."""


def check_live(*, live: bool, live_port: int | None, makes_episodes: bool) -> None:
    """Check the options of the live page.

    Raises:
        UsageError: for a port without the page, or the page of a run that makes no episodes.
    """
    if live_port is not None and not live:
        raise UsageError("--live-port is the port of the live page: add --live")
    if live and not makes_episodes:
        raise UsageError("--live shows a run: leave out --dry-run and --print-config")
