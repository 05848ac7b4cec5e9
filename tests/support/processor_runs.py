"""Episodes of several configs and their checksums, to be run under one processor's settings.

``PYTHONPATH=tests python -m support.processor_runs default:24 wrist:6`` prints JSON: name to
outcomes and checksums.
"""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path

from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.randomization import RANDOMIZE_PRESETS
from grasp_factory.core.config.scene import ClutterConfig
from grasp_factory.policies.model_registry import import_model
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.simulation.world import World

SMALL = (64, 48)


def _learned() -> FactoryConfig:
    sha256 = import_model(Path(sys.argv[1]))
    parameters = {"learned": {"model": sha256}}
    return FactoryConfig(
        policies={"learned": 1.0}, policy_parameters=parameters, resolution=(160, 120)
    )


CASES: Mapping[str, Callable[[], FactoryConfig]] = {
    "default": lambda: FactoryConfig(resolution=SMALL),
    "strong": lambda: FactoryConfig(
        resolution=SMALL, randomize=RANDOMIZE_PRESETS["strong"], clutter=ClutterConfig(count=4)
    ),
    "panda": lambda: FactoryConfig(resolution=SMALL, robot="panda", policies={"antipodal": 1.0}),
    "video": lambda: FactoryConfig(resolution=SMALL, video_hz=20),
    "wrist": lambda: FactoryConfig(
        resolution=SMALL, cameras={name: CAMERAS[name].config for name in ("front", "wrist")}
    ),
    "mixture": lambda: FactoryConfig(resolution=SMALL, policies={"mixture": 1.0, "perturbed": 1.0}),
    "tiny": lambda: FactoryConfig(resolution=(48, 48)),
    "large": FactoryConfig,
    "learned": _learned,
}


def run(case: str, n: int) -> list[tuple[str, str]]:
    """Return outcome and checksum of the first ``n`` episodes of a case."""
    config = CASES[case]()
    found = []
    with World(config.renderer) as world:
        for index in range(n):
            episode = run_episode(world, sample_spec(config, index))
            found.append((episode.outcome.name, episode.checksum()))
    return found


if __name__ == "__main__":
    warnings.simplefilter("error")
    asked = (word.partition(":") for word in sys.argv[1:] if ":" in word)
    print(json.dumps({case: run(case, int(n)) for case, _, n in asked}))
