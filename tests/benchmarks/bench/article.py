"""The article's loop: spawn an object, take a picture, teleport it, take another, save all.

Written afresh from its description, without its sleep. What would crash is mended: pictures come
with an alpha channel, and the renderer is the one that works without a window.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import cv2
import numpy as np
import pybullet as p
import pybullet_data
from benchmarks.bench.score import WARM_UP_EPISODES, Score, Settings, Stopwatch, peak_bytes

OBJECTS = ("cube_small.urdf", "sphere_small.urdf", "duck_vhacd.urdf")
EYE, TARGET, FOV_DEG, NEAR, FAR = (0.8, 0.0, 1.2), (0.0, 0.0, 0.7), 60.0, 0.01, 10.0
LIFTED, DROPPED = (0.0, 0.0, 1.0), (0.0, 0.0, 0.1)


def measure(settings: Settings) -> Score:
    """Run the loop and count what it leaves on the disk."""
    with tempfile.TemporaryDirectory() as place:
        make(Path(place, "warm"), WARM_UP_EPISODES, settings)
        with Stopwatch() as watch:
            make(Path(place, "data"), settings.episodes, settings)
        files = [file for file in Path(place, "data").rglob("*") if file.is_file()]
        stored = sum(file.stat().st_size for file in files)
    return Score(
        episodes=settings.episodes,
        seconds=watch.seconds,
        cpu_seconds=watch.cpu_seconds,
        peak_bytes=peak_bytes(),
        stored_bytes=stored,
    )


def make(out: Path, episodes: int, settings: Settings) -> None:
    """Write that many samples of random grasps below ``out``."""
    for folder in ("rgb", "depth", "seg"):
        (out / folder).mkdir(parents=True)
    rng = np.random.default_rng(0)
    p.connect(p.DIRECT)
    p.setAdditionalSearchPath(pybullet_data.getDataPath())
    p.setGravity(0, 0, -9.8)
    p.loadURDF("plane.urdf")
    p.loadURDF("table/table.urdf", basePosition=[0, 0, 0])
    p.loadURDF("kuka_iiwa/model.urdf", basePosition=[0, 0, 0.6])
    for index in range(episodes):
        body = _spawn(rng)
        p.stepSimulation()
        _grasp(out, index, body, rng, settings)
        p.removeBody(body)
    p.disconnect()


def _spawn(rng: np.random.Generator) -> int:
    x, y = rng.uniform(-0.3, 0.3, 2)
    turn = p.getQuaternionFromEuler(rng.uniform(0.0, 3.14, 3).tolist())
    body: int = p.loadURDF(str(rng.choice(OBJECTS)), [x, y, 0.75], turn)
    return body


def _grasp(out: Path, index: int, body: int, rng: np.random.Generator, settings: Settings) -> None:
    _save(out, f"before_{index}", settings)
    x, y, z = p.getBasePositionAndOrientation(body)[0]
    downwards = p.getQuaternionFromEuler([0, 3.14, 0])
    success = bool(rng.random() > 0.5)
    p.resetBasePositionAndOrientation(body, LIFTED if success else DROPPED, downwards)
    _save(out, f"after_{index}", settings)
    label = {
        "index": index,
        "success": success,
        "grasp_position": [x, y, z + 0.02],
        "grasp_orientation": downwards,
        "object_id": body,
    }
    np.save(out / f"label_{index}.npy", np.array(label, dtype=object))


def _save(out: Path, name: str, settings: Settings) -> None:
    """Take a picture and write colours, depth in metres and body ids."""
    _, _, rgba, zbuffer, segmentation = p.getCameraImage(
        settings.width,
        settings.height,
        viewMatrix=p.computeViewMatrix(EYE, TARGET, [0, 0, 1]),
        projectionMatrix=p.computeProjectionMatrixFOV(
            FOV_DEG, settings.width / settings.height, NEAR, FAR
        ),
        renderer=p.ER_TINY_RENDERER,
    )
    cv2.imwrite(str(out / "rgb" / f"{name}.png"), cv2.cvtColor(rgba, cv2.COLOR_RGBA2BGR))
    np.save(out / "depth" / f"depth_{name}.npy", FAR * NEAR / (FAR - (FAR - NEAR) * zbuffer))
    np.save(out / "seg" / f"seg_{name}.npy", segmentation)
