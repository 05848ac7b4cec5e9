"""PyBullet's own grasping environment, KukaDiverseObjectEnv, with one object, straight down.

It needs `gym`, of which it uses four names; where gym is not installed these stand in for it:
``gym.Env`` (an empty base class), ``gym.spaces.Box`` and ``Discrete`` (kept, never asked),
``gym.utils.seeding.np_random`` (returns a generator). The two packages around the environment are
entered without running their own start, which would register everything else they have.
``pkg_resources.parse_version``, which it uses to tell old versions of gym, is a stand-in too.
"""

from __future__ import annotations

import importlib.util
import random
import sys
import warnings
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
from benchmarks.bench.score import NotAvailable, Score, Settings, Stopwatch, peak_bytes

SHARE = 8
"""It takes seconds an episode at 640x480, so it makes one in so many of what others make."""


def measure(settings: Settings) -> Score:
    """Make a share of the episodes; it stores nothing, which is in its favour."""
    env = _environment(settings)
    episodes = max(1, settings.episodes // SHARE)
    random.seed(0)
    np.random.seed(0)  # it draws from the global generators
    _grasp(env)
    with Stopwatch() as watch:
        for _ in range(episodes):
            _grasp(env)
    return Score(
        episodes=episodes,
        seconds=watch.seconds,
        cpu_seconds=watch.cpu_seconds,
        peak_bytes=peak_bytes(),
    )


def _grasp(env: Any) -> None:
    env.reset()
    done = False
    while not done:
        _, _, done, _ = env.step([0.0, 0.0, 0.0])


def _environment(settings: Settings) -> Any:
    for name, module in _stand_ins().items():
        sys.modules.setdefault(name, module)
    try:
        with warnings.catch_warnings(action="ignore"):
            module = importlib.import_module("pybullet_envs.bullet.kuka_diverse_object_gym_env")
    except ImportError as error:
        raise NotAvailable(str(error)) from None
    return module.KukaDiverseObjectEnv(
        numObjects=1, width=settings.width, height=settings.height, isTest=True
    )


def _stand_ins() -> dict[str, ModuleType]:
    spec = importlib.util.find_spec("pybullet_data")
    if spec is None or spec.origin is None:
        raise NotAvailable("there is no pybullet_data")
    site = Path(spec.origin).parents[1]
    made = {
        "pybullet_envs": _module("pybullet_envs", __path__=[str(site / "pybullet_envs")]),
        "pybullet_envs.bullet": _module(
            "pybullet_envs.bullet", __path__=[str(site / "pybullet_envs" / "bullet")]
        ),
        "pkg_resources": _module(
            "pkg_resources", parse_version=lambda text: tuple(map(int, text.split(".")))
        ),
    }
    if importlib.util.find_spec("gym"):
        return made
    keeps = type("Space", (SimpleNamespace,), {})
    seeding = _module("gym.utils.seeding", np_random=lambda seed=None: (np.random, seed))
    spaces = _module("gym.spaces", Box=lambda **_: keeps(), Discrete=lambda n: keeps(n=n))
    utils = _module("gym.utils", seeding=seeding)
    gym = _module(
        "gym", Env=object, spaces=spaces, utils=utils, error=Exception, __version__="0.26.0"
    )
    parts = {"gym": gym, "gym.spaces": spaces, "gym.utils": utils, "gym.utils.seeding": seeding}
    return made | parts


def _module(name: str, **contents: Any) -> ModuleType:
    module = ModuleType(name)
    module.__dict__.update(contents)
    return module
