"""A robot, a policy, objects, a sensor, an exporter, an executor, a command: one file, one row.

A copy of the package gets one new file for each, and in the kind's table its import and its row.
Then the real command, in a process of its own, lists each and uses it, with one worker and with
two, which are spawned and import the package by themselves. Nothing else is edited.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
import zarr
from support.helpers import assert_same_tree

import grasp_factory
from grasp_factory.cli.main import COMMANDS
from grasp_factory.core.episode import Episode
from grasp_factory.dataset.dataset import Dataset

PACKAGE = Path(grasp_factory.__file__).parent
pytestmark = pytest.mark.slow


@dataclass(frozen=True, kw_only=True)
class Addition:
    """One file, and one row in a table."""

    file: str
    text: str
    table: str
    """The file that holds the table."""
    imported: str
    row: str
    before: str
    """A pattern of the table's text, right after which the row stands."""


ROBOT = '''
"""The iiwa with another home posture and a weaker gripper."""

from __future__ import annotations

import dataclasses

from grasp_factory.robots.kuka_iiwa import KUKA_IIWA

TURNED_IIWA = dataclasses.replace(
    KUKA_IIWA,
    name="turned_iiwa",
    description="KUKA iiwa that waits to the left, with a gripper of up to 25 N",
    home=(0.3, *KUKA_IIWA.home[1:]),
    gripper=dataclasses.replace(KUKA_IIWA.gripper, force_range=(5.0, 25.0)),
)
'''

POLICY = '''
"""Straight down on the middle of what is seen of the target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasp_factory.core.episode import Grasp, GraspPlan, SceneView
from grasp_factory.core.serialization import check_range
from grasp_factory.policies.base import TIP_CLEARANCE, Policy, looking_down, target_points


@dataclass(frozen=True, slots=True, kw_only=True)
class CentralParameters:
    """Settings of ``central``."""

    yaw: float = 0.0
    """rad."""

    def __post_init__(self) -> None:
        check_range(self, "yaw", -3.2, 3.2, "rad")


def plan(view: SceneView, rng: np.random.Generator, settings: CentralParameters) -> GraspPlan:
    points = target_points(view)
    if not len(points):
        return GraspPlan(grasps=())
    x, y, _ = points.mean(axis=0)
    z = view.gripper.tip_distance + TIP_CLEARANCE
    T_world_tcp = looking_down(x, y, z, settings.yaw)
    return GraspPlan(grasps=(Grasp(T_world_tcp=T_world_tcp, width=view.gripper.max_width),))


CENTRAL = Policy(
    name="central",
    description="straight down on the middle of the visible points",
    parameters=CentralParameters,
    plan=plan,
)
'''

OBJECTS = '''
"""Bricks of three lengths."""

from __future__ import annotations

from grasp_factory.objects.base import Compound, FiniteSet, ObjectModel, Part


def _brick(length: float) -> ObjectModel:
    x, y, z = size = (length, 0.04, 0.03)
    name = f"bricks/{round(1000 * length)}"
    return ObjectModel(
        object_id=name,
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


BRICKS = FiniteSet(
    name="bricks",
    description="wooden bricks of three lengths",
    models={brick.object_id: brick for brick in map(_brick, (0.05, 0.07, 0.09))},
)
'''

SENSOR = '''
"""The torque of the elbow's motor."""

from __future__ import annotations

from array import array

import numpy as np

from grasp_factory.simulation.scene import Scene
from grasp_factory.simulation.sensors.base import Sensor, Tick


class ElbowTorque(Sensor):
    """See ``core.sensors``."""

    def __init__(self, scene: Scene) -> None:
        self._torques = array("d")

    def sample(self, tick: Tick) -> None:
        self._torques.append(tick.joints[3][3])

    def arrays(self) -> dict[str, np.ndarray]:
        return {"elbow_torque": np.array(self._torques, np.float32)}
'''

EXPORTER = '''
"""A table of outcomes."""

from __future__ import annotations

from collections.abc import Sequence

from grasp_factory.writers.exporters.base import ExportContents, Exporter, ExportJob, ExportPart


def write_part(job: ExportJob, part: ExportPart) -> str:
    return "".join(f"{place},{episode.outcome.name}\\n" for place, episode in part.episodes)


def finish(job: ExportJob, parts: Sequence[str]) -> None:
    (job.folder / "outcomes.csv").write_text("".join(parts), encoding="utf-8")


OUTCOMES = Exporter(
    name="outcomes",
    description="an episode and its outcome a line",
    contents=ExportContents(written=(), left_out={"*": "the table holds outcomes only"}),
    write_part=write_part,
    finish=finish,
)
'''

EXECUTOR = '''
"""Jobs from the last to the first."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from grasp_factory.core.executors.base import Executor, ExecutorKind


class BackwardExecutor(Executor):
    def run(self, task: Any, jobs: Sequence[Any], report: Any, *_: Any, **__: Any) -> list[Any]:
        return [task(job, report) for job in reversed(jobs)][::-1]


BACKWARD = ExecutorKind(
    name="backward",
    description="in the process of the command, the last job first",
    make=lambda settings: BackwardExecutor(),
)
'''

COMMAND = '''
"""The command that counts."""

from __future__ import annotations

from pathlib import Path

import click

from grasp_factory.cli.params import STORE, Command


@click.command(cls=Command, examples=("grasp-factory count-rows grasps.zarr",))
@STORE
def count_rows(path: Path) -> None:
    """Count the rows of the store at PATH."""
    from grasp_factory.dataset.dataset import Dataset  # noqa: PLC0415

    click.echo(len(Dataset(path)))
'''

ADDITIONS = {
    "robot": Addition(
        file="robots/turned_iiwa.py",
        text=ROBOT,
        table="robots/__init__.py",
        imported="from grasp_factory.robots.turned_iiwa import TURNED_IIWA",
        row="TURNED_IIWA, ",
        before=r"ROBOTS: (?s:.*?) for \w+ in \(",
    ),
    "policy": Addition(
        file="policies/central.py",
        text=POLICY,
        table="policies/direct.py",
        imported="from grasp_factory.policies.central import CENTRAL",
        row="CENTRAL, ",
        before=r"DIRECT: (?s:.*?) for \w+ in \(",
    ),
    "object set": Addition(
        file="objects/bricks.py",
        text=OBJECTS,
        table="objects/__init__.py",
        imported="from grasp_factory.objects.bricks import BRICKS",
        row="BRICKS, ",
        before=r"OBJECT_SETS: (?s:.*?) for \w+ in \(",
    ),
    "sensor": Addition(
        file="simulation/sensors/elbow.py",
        text=SENSOR,
        table="core/sensors.py",
        imported="",
        row="""SensorModel(
            name="elbow", description="torque of the elbow's motor", group=STREAMS,
            implementation=f"{_HERE}.elbow:ElbowTorque",
            fields=(STREAMS.series("elbow_torque", (), "float32", "applied", units="N m"),),
        ), """,
        before=r"SENSORS: (?s:.*?) for model in \(",
    ),
    "exporter": Addition(
        file="writers/exporters/outcomes.py",
        text=EXPORTER,
        table="writers/exporters/__init__.py",
        imported="from grasp_factory.writers.exporters.outcomes import OUTCOMES",
        row="OUTCOMES, ",
        before=r"EXPORTERS: (?s:.*?) for \w+ in \(",
    ),
    "executor": Addition(
        file="core/executors/backward.py",
        text=EXECUTOR,
        table="core/executors/kinds.py",
        imported="from grasp_factory.core.executors.backward import BACKWARD",
        row="BACKWARD, ",
        before=r"EXECUTORS: (?s:.*?) for \w+ in \(",
    ),
    "command": Addition(
        file="cli/count_rows.py",
        text=COMMAND,
        table="cli/main.py",
        imported="from grasp_factory.cli.count_rows import count_rows",
        row="count_rows, ",
        before=r'COMMANDS: (?s:.*?)": \(',
    ),
}


def add(package: Path, addition: Addition) -> None:
    """Write the one file, and the import and the row in its table."""
    new, table = package / addition.file, package / addition.table
    assert not new.exists()
    new.write_text(addition.text.lstrip())
    text = table.read_text()
    (place,) = re.finditer(addition.before, text)
    text = text[: place.end()] + addition.row + text[place.end() :]
    first = text.index("\nfrom grasp_factory.")
    table.write_text(f"{text[:first]}\n{addition.imported}{text[first:]}")


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a copy of the package that has all the additions."""
    folder = tmp_path_factory.mktemp("user")
    shutil.copytree(PACKAGE, folder / "grasp_factory")
    for addition in ADDITIONS.values():
        add(folder / "grasp_factory", addition)
    return folder


def run(package: Path, *args: object) -> subprocess.CompletedProcess[str]:
    """Run the command of the copy."""
    return subprocess.run(
        [sys.executable, "-m", "grasp_factory", *map(str, args)],
        cwd=package,
        env=os.environ | {"PYTHONPATH": str(package)},
        capture_output=True,
        text=True,
        check=False,
    )


def printed(package: Path, *args: object) -> str:
    """Return what the command of the copy prints, which does what it is asked to."""
    done = run(package, *args)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


@pytest.mark.parametrize(
    ("command", "name"),
    [
        ("robots", "turned_iiwa"),
        ("policies", "central"),
        ("objects", "bricks"),
        ("sensors", "elbow"),
        ("export --list", "outcomes"),
    ],
)
def test_it_is_listed(package: Path, command: str, name: str) -> None:
    found = json.loads(printed(package, *command.split(), "--json"))
    assert name in found
    assert len(str(found[name])) > 10


def generated(package: Path, kind: str, *words: object) -> list[Episode]:
    """Make two episodes with one worker and with two, which are the same, and return them."""
    for workers in (1, 2):
        settings = ("--resolution", "32x24", "--set", "block_size=1", "--workers", workers)
        out = package / f"{kind}{workers}.zarr"
        printed(package, "generate", "--n", 2, "--quiet", "--out", out, *settings, *words)
    assert_same_tree(package / f"{kind}1.zarr", out)
    assert json.loads(printed(package, "verify", out, "--deep", 1, "--json"))["is_whole"]
    dataset = Dataset(out)
    assert dataset.committed.tolist() == [0, 1]
    torques = zarr.open_array(out, path="streams/elbow_torque", mode="r")[:]
    joints = dataset.series(0, "joint_torques")["joint_torques"]
    assert torques[0, : len(joints)].tolist() == joints[:, 3].tolist()
    return list(dataset)


def test_a_robot_makes_episodes(package: Path) -> None:
    episodes = generated(package, "robot", "--robot", "turned_iiwa")
    assert {episode.spec.robot for episode in episodes} == {"turned_iiwa"}
    for episode in episodes:
        assert episode.streams["joint_positions"][0, 0] == pytest.approx(0.3, abs=0.01)


def test_a_robots_own_limits_are_checked(package: Path) -> None:
    words = ("--robot", "turned_iiwa", "--set", "motion.grip_force=40")
    done = run(package, "generate", *words, "--n", 1, "--out", package / "refused.zarr")
    assert done.returncode == 2
    assert "valid: 5 to 25 N, which is what the gripper of turned_iiwa can do" in done.stderr


def test_a_policy_plans_grasps(package: Path) -> None:
    episodes = generated(package, "policy", "--policy", "central")
    assert {episode.spec.policy for episode in episodes} == {"central"}
    assert {episode.columns["grasp_proposer"] for episode in episodes} == {"central"}


@pytest.mark.soak
def test_an_object_set_is_dropped(package: Path) -> None:
    episodes = generated(package, "objects", "--objects", "bricks")
    for episode in episodes:
        assert str(episode.columns["object_id"]).startswith("bricks/")


@pytest.mark.soak
def test_an_executor_makes_episodes(package: Path) -> None:
    generated(package, "executor", "--executor", "backward")


def test_an_exporter_writes(package: Path, tmp_path: Path) -> None:
    store = package / "exported.zarr"
    printed(package, "generate", "--n", 2, "--quiet", "--out", store, "--resolution", "32x24")
    printed(package, "export", store, tmp_path / "out", "--to", "outcomes", "--workers", 2)
    lines = (tmp_path / "out/outcomes.csv").read_text().splitlines()
    outcomes = [episode.outcome.name for episode in Dataset(store)]
    assert lines == [f"{row},{name}" for row, name in enumerate(outcomes)]
    assert printed(package, "count-rows", store) == "2\n"


def test_a_command_stands_under_its_heading(package: Path) -> None:
    text = printed(package, "--help")
    first, second, *_ = COMMANDS
    heading = text[text.index(f"{first}:") : text.index(f"{second}:")]
    assert re.search(r"count-rows +Count the rows of the store at PATH\.", heading)
