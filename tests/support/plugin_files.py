"""Files of a user with a policy, a robot, an object set and a sensor."""

from __future__ import annotations

from pathlib import Path

from grasp_factory.core.plugins import plugin_sources
from grasp_factory.factory import plugins
from grasp_factory.factory.plugin_rows import TABLES

POLICY = '''\
"""Straight down on the middle of what is seen of the target."""

import numpy as np

from grasp_factory.core.episode import Grasp, GraspPlan, SceneView
from grasp_factory.policies.base import TIP_CLEARANCE, looking_down, target_points


def plan(view: SceneView, rng: np.random.Generator, settings: object) -> GraspPlan:
    """Straight down on the middle of the target."""
    points = target_points(view)
    if not len(points):
        return GraspPlan(grasps=())
    x, y, _ = points.mean(axis=0)
    z = view.gripper.tip_distance + TIP_CLEARANCE
    T_world_tcp = looking_down(x, y, z, yaw=0.0)
    return GraspPlan(grasps=(Grasp(T_world_tcp=T_world_tcp, width=view.gripper.max_width),))
'''

ROBOT = '''\
"""The iiwa with another home posture."""

from __future__ import annotations

import dataclasses

from grasp_factory.robots.kuka_iiwa import KUKA_IIWA

ROBOT = dataclasses.replace(
    KUKA_IIWA,
    name="turned",
    description="KUKA iiwa that waits to the left",
    home=(0.3, *KUKA_IIWA.home[1:]),
)
'''

OBJECTS = '''\
"""Bricks of three lengths."""

from __future__ import annotations

from grasp_factory.objects.base import Compound, FiniteSet, ObjectModel, Part


def brick(length: float) -> ObjectModel:
    x, y, z = size = (length, 0.04, 0.03)
    return ObjectModel(
        object_id=f"bricks/{round(1000 * length)}",
        family="brick",
        body=Compound(
            parts=(Part(shape="box", size=size),),
            gyration_squared=((y * y + z * z) / 12, (x * x + z * z) / 12, (x * x + y * y) / 12),
        ),
        lower=(-x / 2, -y / 2, -z / 2),
        upper=(x / 2, y / 2, z / 2),
        mass=700.0 * x * y * z,
        lateral_friction=0.6,
        color=(0.7, 0.3, 0.2),
    )


MODELS = {model.object_id: model for model in map(brick, (0.05, 0.08, 0.11))}
SET = FiniteSet(name="bricks", description="bricks of three lengths", models=MODELS)
'''

SENSOR = '''\
"""How near the pads are to the target."""

import numpy as np

from grasp_factory.core.sensors import STREAMS, SensorModel
from grasp_factory.simulation.scene import Scene
from grasp_factory.simulation.sensors import Sensor, Tick


class Proximity(Sensor):
    """The distance of both pads to the target's centre of mass."""

    def __init__(self, scene: Scene) -> None:
        self._distances: list[list[float]] = []

    def sample(self, tick: Tick) -> None:
        target, _ = tick.scene.world.com_frame(tick.scene.objects[0])
        pads = [position for position, _ in tick.frames[1:]]
        self._distances.append([float(np.linalg.norm(np.subtract(pad, target))) for pad in pads])

    def arrays(self) -> dict[str, np.ndarray]:
        return {"proximity": np.array(self._distances, np.float32).reshape(-1, 2)}


PROXIMITY = SensorModel(
    name="proximity",
    description="distance of both pads to the target",
    group=STREAMS,
    implementation=Proximity,
    fields=(STREAMS.series("proximity", (2,), "float32", "left and right pad", units="m"),),
)
'''

FILES = {
    "my_policy.py": POLICY,
    "my_robot.py": ROBOT,
    "my_set.py": OBJECTS,
    "my_sensor.py": SENSOR,
}
OPTIONS = {
    "--policy": "my_policy.py:plan",
    "--robot": "my_robot.py:ROBOT",
    "--objects": "my_set.py:SET",
    "--sensor": "my_sensor.py:PROXIMITY",
}
"""Options of ``generate`` that use them."""


def write_plugins(folder: Path) -> Path:
    """Write the files to a folder, and return it."""
    for name, text in FILES.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def forget_plugins() -> None:
    """Forget the plugins of this process."""
    for kind, name in plugins._ACTIVE:
        del TABLES[kind][name]
    plugins._ACTIVE.clear()
    plugin_sources._ALLOWED.clear()
