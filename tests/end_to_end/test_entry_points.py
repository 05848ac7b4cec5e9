"""Rows of tables that an installed package offers: a folder with its dist-info is on the path."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.places import REPOSITORY
from support.plugin_files import OBJECTS, POLICY, ROBOT, SENSOR

from grasp_factory.dataset.dataset import Dataset
from grasp_factory.robots.kuka_iiwa import KUKA_IIWA

pytestmark = pytest.mark.slow

EXPORTER = """\
from grasp_factory.writers.exporters import ExportContents, Exporter


def write_part(job, part):
    return [(place, episode.outcome.name) for place, episode in part.episodes]


def finish(job, parts):
    lines = [f"{place},{name}\\n" for part in parts for place, name in part]
    (job.folder / "outcomes.csv").write_text("".join(lines))


OUTCOMES = Exporter(
    name="outcomes",
    description="one line of CSV with the outcome of each episode",
    contents=ExportContents(written=(), left_out={"*": "the table holds outcomes only"}),
    write_part=write_part,
    finish=finish,
)
"""
ENTRY_POINTS = """\
[grasp_factory.policies]
central = my_grasps.policy:plan

[grasp_factory.robots]
turned = my_grasps.robot:ROBOT

[grasp_factory.object_sets]
bricks = my_grasps.bricks:SET

[grasp_factory.sensors]
proximity = my_grasps.sensor:PROXIMITY

[grasp_factory.exporters]
outcomes = my_grasps.exporter:OUTCOMES
"""
FILES = {
    "__init__.py": "",
    "policy.py": POLICY,
    "robot.py": ROBOT.replace(
        "import dataclasses", "import dataclasses\nfrom pathlib import Path"
    ).replace("    home=", '    urdf=str(Path(__file__).with_name("mine.urdf")),\n    home='),
    "mine.urdf": KUKA_IIWA.path().read_text(encoding="utf-8"),
    "bricks.py": OBJECTS,
    "sensor.py": SENSOR,
    "exporter.py": EXPORTER,
}
MINE = ("--policy", "central", "--robot", "turned", "--objects", "bricks", "--sensor", "proximity")
SMALL = ("--resolution", "32x24", "--set", "block_size=1", "--set", "motion.hold_s=0.1")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with an installed package, ``my-grasps`` 1.2."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "my_grasps").mkdir()
    for name, text in FILES.items():
        (folder / "my_grasps" / name).write_text(text)
    info = folder / "my_grasps-1.2.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-grasps\nVersion: 1.2\n")
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    return folder


def command(site: Path | None, folder: Path, *words: object) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join(map(str, [REPOSITORY, *([site] if site else [])]))
    return subprocess.run(
        [sys.executable, "-m", "grasp_factory", *map(str, words)],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def made(site: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with ``a.zarr``, made from the package with two workers."""
    folder = tmp_path_factory.mktemp("made")
    words = ("--n", 2, "--quiet", "--out", "a.zarr", *SMALL, *MINE, "--workers", 2)
    done = command(site, folder, "generate", *words)
    assert done.returncode == 0, done.stderr
    return folder


def test_the_store_names_the_package_and_its_version(made: Path) -> None:
    dataset = Dataset(made / "a.zarr")
    origin = dataset.config.plugins["policies"]["central"]
    assert (origin.distribution, origin.version, origin.file) == ("my-grasps", "1.2", "")
    assert (origin.module, origin.attribute) == ("my_grasps.policy", "plan")
    assert {episode.spec.policy for episode in dataset} == {"central"}
    assert dataset[0].streams["proximity"].shape == (dataset[0].n_steps, 2)
    assert not (made / "a.zarr" / "plugins").exists()


def test_it_replays_where_the_package_is_installed(site: Path, made: Path) -> None:
    done = command(site, made, "replay", "a.zarr", 1)
    assert "replays to the same bytes" in done.stdout, done.stderr


def refusal(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode == 2, done.stdout + done.stderr
    (line,) = done.stderr.splitlines()
    return line


def test_without_the_package_it_says_what_to_install(made: Path) -> None:
    line = refusal(command(None, made, "replay", "a.zarr", 1))
    assert line.endswith(
        "is of the package my-grasps 1.2, which is not installed: pip install 'my-grasps==1.2'"
    )


def test_another_source_of_the_package_is_refused(site: Path, made: Path, tmp_path: Path) -> None:
    other = Path(shutil.copytree(site, tmp_path / "site"))
    with (other / "my_grasps" / "__init__.py").open("a") as file:
        file.write("# another\n")
    line = refusal(command(other, made, "replay", "a.zarr", 1))
    assert "was made with my-grasps 1.2, and the source of my-grasps 1.2, which is" in line


@pytest.mark.parametrize(
    ("listing", "name"),
    [
        ("policies", "central"),
        ("robots", "turned"),
        ("objects", "bricks"),
        ("sensors", "proximity"),
    ],
)
def test_it_is_listed_without_being_imported(
    site: Path, tmp_path: Path, listing: str, name: str
) -> None:
    other = Path(shutil.copytree(site, tmp_path / "site"))
    (other / "my_grasps" / "__init__.py").write_text("raise SystemExit('it was imported')")
    found = json.loads(command(other, tmp_path, listing, "--json").stdout)
    assert found[name] == "of the installed package my-grasps 1.2"


def test_an_exporter_writes_with_two_workers(site: Path, made: Path, tmp_path: Path) -> None:
    words = ("export", "a.zarr", tmp_path / "out", "--to", "outcomes", "--workers", 2)
    done = command(site, made, *words)
    assert done.returncode == 0, done.stderr
    assert len((tmp_path / "out/outcomes.csv").read_text().splitlines()) == 2
    assert "outcomes" in json.loads(command(site, made, "export", "--list", "--json").stdout)


def test_the_checks_run_on_it(site: Path, tmp_path: Path) -> None:
    done = command(site, tmp_path, "conformance", "central")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "policy central: 9 checks passed" in done.stdout


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("raise ValueError('broken')", "my_grasps.policy:plan of my-grasps 1.2 cannot be loaded: "),
        ("plan = 3", "my_grasps.policy:plan is no policy: got 3, valid: a function plan("),
    ],
)
def test_a_package_that_cannot_be_used_is_one_line(
    site: Path, tmp_path: Path, text: str, said: str
) -> None:
    other = Path(shutil.copytree(site, tmp_path / "site"))
    (other / "my_grasps" / "policy.py").write_text(text)
    done = command(other, tmp_path, "generate", "--policy", "central", "--out", "a.zarr")
    assert said in refusal(done)
