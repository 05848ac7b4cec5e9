"""A new sensor with its own rate is one file and one row; the rest of the package follows."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from support.helpers import tree
from support.places import REPOSITORY, TESTS, TINY
from support.scenes import cube_spec
from support.stored import old_store

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.sensors import SENSORS, SensorModel, SeriesGroup
from grasp_factory.curation.verify.time_series import series_faults
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.index import fresh
from grasp_factory.errors import ConfigError
from grasp_factory.factory.generate import generate

pytestmark = pytest.mark.slow

FILE = """
from array import array

import numpy as np

from grasp_factory.simulation.sensors import Sensor


class ElbowTorque(Sensor):
    def __init__(self, scene):
        self._times, self._torques = [], array("d")

    def sample(self, tick):
        self._times.append(tick.timestamp)
        self._torques.append(tick.joints[3][3])

    def arrays(self):
        return {
            "timestamp": np.array(self._times, np.float64),
            "torque": np.array(self._torques, np.float32),
        }
"""
ROW = """
from grasp_factory.core.sensors import SENSORS, SensorModel, SeriesGroup

ELBOW = SeriesGroup(
    name="elbow", title="the elbow's series", dim="E", dimension_name="elbow_step",
    count="n_elbow", rate=lambda rates: 80,
)
SENSORS["elbow"] = SensorModel(
    name="elbow",
    description="torque of the elbow's motor",
    group=ELBOW,
    implementation="elbow_torque:ElbowTorque",
    fields=(
        ELBOW.series("timestamp", (), "float64", "simulation time", units="s"),
        ELBOW.series("torque", (), "float32", "applied by the motor", units="N m"),
    ),
)
"""
READ = """
import json, sys
from grasp_factory import Dataset

dataset = Dataset(sys.argv[1])
print(json.dumps([
    {
        "checksum": episode.checksum(),
        "streams": [t for t in episode.streams["timestamp"].tolist()],
        "joint": episode.streams["joint_torques"][:, 3].tolist(),
        **{name: values.tolist() for name, values in episode.own_rate.get("elbow", {}).items()},
    }
    for episode in dataset[dataset.committed]
]))
"""
MAKE = "generate --n 4 --seed 0 --resolution 64x48 --set block_size=2 --quiet".split()

Python = Callable[..., str]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the sensor's file, and with its row, which every process adds."""
    folder = tmp_path_factory.mktemp("elbow")
    (folder / "elbow_torque.py").write_text(FILE, encoding="utf-8")
    (folder / "sitecustomize.py").write_text(ROW, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def python(folder: Path) -> Python:
    """Run Python where the sensor is in the table, and return what it printed."""
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (folder, REPOSITORY, TESTS)))}

    def run(*words: object) -> str:
        done = subprocess.run(
            [sys.executable, *map(str, words)],
            cwd=folder,
            env=env,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return run


@pytest.fixture(scope="module")
def command(python: Python) -> Python:
    return lambda *words: python("-m", "grasp_factory", *words)


@pytest.fixture(scope="module")
def fails(folder: Path) -> Python:
    """Run the command where the sensor is in the table, and return what it said as it failed."""
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (folder, REPOSITORY, TESTS)))}

    def run(*words: object) -> str:
        done = subprocess.run(
            [sys.executable, "-m", "grasp_factory", *map(str, words)],
            cwd=folder,
            env=env,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode in (1, 2), done.stdout + done.stderr
        assert "Traceback" not in done.stderr
        return done.stdout + done.stderr

    return run


def tmp_config(store: Path) -> Path:
    """Write the config of a store beside it, and return the file."""
    file = store.with_suffix(".yaml")
    file.write_text(yaml.safe_dump(Dataset(store).config.to_plain()), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def store(folder: Path, command: Python) -> Path:
    command(*MAKE, "--workers", 2, "--out", folder / "elbow.zarr")
    return folder / "elbow.zarr"


def test_it_is_listed(command: Python) -> None:
    assert json.loads(command("sensors", "--json"))["elbow"] == "torque of the elbow's motor"


def test_info_shows_its_arrays(store: Path, command: Python) -> None:
    arrays = {row["path"]: row for row in json.loads(command("info", store, "--json"))["arrays"]}
    rows, most = arrays["elbow/torque"]["shape"]
    assert (rows, arrays["elbow/torque"]["units"]) == (4, "N m")
    assert most * 120 >= arrays["streams/timestamp"]["shape"][1] * 80
    assert {"elbow/timestamp", "episodes/n_elbow"} <= set(arrays)
    assert "elbow/torque" in command("info", store, "--full")


def test_verify_accepts_the_store(store: Path, command: Python) -> None:
    assert json.loads(command("verify", store, "--deep", 1, "--json"))["problems"] == []


def test_a_dataset_returns_what_the_encoders_saw_at_the_same_instants(
    store: Path, python: Python
) -> None:
    episodes = json.loads(python("-c", READ, store))
    moved = [episode for episode in episodes if episode["streams"]]
    assert moved
    for episode in moved:
        times = np.array(episode["timestamp"])
        assert times == pytest.approx(np.arange(1, len(times) + 1) / 80, abs=1e-9)
        assert len(times) == len(episode["torque"])
        assert abs(times[-1] - episode["streams"][-1]) < 1 / 80
        both = zip(episode["torque"][1::2], episode["joint"][2::3], strict=False)  # at 40 Hz
        assert [elbow for elbow, joint in both if elbow != joint] == []


@pytest.mark.soak
def test_one_worker_makes_the_same_episodes(
    store: Path, folder: Path, command: Python, python: Python
) -> None:
    command(*MAKE, "--workers", 1, "--out", folder / "alone.zarr")
    made, alone = (json.loads(python("-c", READ, path)) for path in (store, folder / "alone.zarr"))
    assert made == alone


@pytest.mark.soak
def test_it_passes_the_conformance_suite(python: Python) -> None:
    suite = TESTS / "conformance" / "test_sensors.py"
    out = python("-m", "pytest", suite, "-q", "-k", "elbow", "-p", "no:cacheprovider")
    assert " passed" in out
    assert "skipped" not in out


def test_stores_from_before_it_are_read_and_verified(
    tmp_path: Path, command: Python, python: Python
) -> None:
    for store in (TINY, old_store(tmp_path)):
        episodes = json.loads(python("-c", READ, store))
        assert episodes
        assert all("torque" not in episode for episode in episodes)
        assert json.loads(command("verify", store, "--json"))["problems"] == []


class TestAStoreFromBeforeIt:
    @pytest.fixture
    def before(self, tmp_path: Path) -> Path:
        return Path(shutil.copytree(TINY, tmp_path / "before.zarr"))

    def test_replays_to_the_same_bytes(self, before: Path, command: Python) -> None:
        found = json.loads(command("replay", before, 0, "--json"))
        assert found["same"], found["difference"]

    @pytest.mark.soak
    def test_is_split_and_merged_as_it_was(
        self, before: Path, tmp_path: Path, command: Python
    ) -> None:
        for words in (("split", before), ("merge",)):
            out = tmp_path / f"{words[0]}.zarr"
            command(*words, out, *(("--episodes", "0,1") if words[0] == "split" else (before,)))
            assert json.loads(command("verify", out, "--json"))["is_whole"]
            assert not (out / "elbow").exists()

    @pytest.mark.soak
    def test_is_not_merged_with_one_that_has_it(
        self, store: Path, tmp_path: Path, command: Python, fails: Python
    ) -> None:
        generate(dataclasses.replace(Dataset(store).config, seed=9), 1, tmp_path / "plain")
        text = fails("merge", tmp_path / "out.zarr", store, tmp_path / "plain")
        assert "has the array elbow/timestamp, which" in text
        assert "merge stores of one version" in text

    def test_does_not_grow(self, before: Path, fails: Python) -> None:
        settings = tmp_config(before)
        text = fails("generate", "--config", settings, "--n", 99, "--out", before)
        assert "was made by another version: " in text
        assert "use that version or choose another --out" in text

    def test_is_not_simulated_again_by_a_repair(
        self, before: Path, command: Python, fails: Python
    ) -> None:
        (before / "streams" / "phase" / "0.0").unlink()
        files = tree(before)
        text = fails("repair", before)
        assert "this version also records episodes/n_elbow, which the store does not have" in text
        assert tree(before) == files

    def test_an_index_from_before_it_is_built_again(
        self, before: Path, tmp_path: Path, command: Python
    ) -> None:
        with fresh([before], tmp_path / "i.sqlite") as index:
            assert index.stores
        words = ("query", before, "--index", tmp_path / "i.sqlite")
        rows = json.loads(command(*words, "--columns", "row,n_elbow", "--json"))["rows"]
        assert {row["n_elbow"] for row in rows} == {None}
        assert command(*words, "--where", "n_elbow>=1000000", "--count") == "0\n"


GROUP = SeriesGroup(
    name="elbow",
    title="the elbow's series",
    dim="E",
    dimension_name="elbow_step",
    count="n_elbow",
    rate=lambda rates: 80,
)


@pytest.fixture
def in_the_table(monkeypatch: pytest.MonkeyPatch) -> SeriesGroup:
    model = SensorModel(
        name="elbow", description="an elbow", group=GROUP, fields=(), implementation="elbow:Elbow"
    )
    monkeypatch.setitem(SENSORS, "elbow", model)
    return GROUP


@pytest.mark.parametrize(
    ("times", "faults"),
    [
        (np.arange(1, 81) / 80, 0),
        (np.delete(np.arange(1, 82) / 80, 40), 1),
        (np.arange(1, 41) / 80, 1),
    ],
    ids=["even", "with a gap", "too short"],
)
def test_verify_finds_times_that_are_not_even_or_end_early(
    in_the_table: SeriesGroup, times: np.ndarray, faults: int
) -> None:
    streams = {
        "streams/timestamp": np.arange(1, 121) / 120,
        "streams/phase": np.zeros(120, np.uint8),
        "streams/shake_level": np.zeros(120),
        "streams/tactile_body": np.zeros((120, 2, 12), np.uint8),
        "streams/tactile_depth": np.full((120, 2, 12), np.nan),
    }
    vectors = {
        f"streams/tactile_{name}": np.full((120, 2, 12, 3), np.nan)
        for name in ("position", "force", "normal")
    }
    contents = {**streams, **vectors, "elbow/timestamp": times}
    found = [path for path, _ in series_faults(contents, cube_spec())]
    assert found == ["elbow/timestamp"] * faults


def test_a_rate_that_does_not_divide_the_physics_rates_is_refused(
    in_the_table: SeriesGroup, monkeypatch: pytest.MonkeyPatch
) -> None:
    FactoryConfig()
    odd = SeriesGroup(**{f: getattr(GROUP, f) for f in GROUP.__slots__} | {"rate": lambda _: 100})
    model = SENSORS["elbow"]
    changed = {f: getattr(model, f) for f in model.__slots__} | {"group": odd}
    monkeypatch.setitem(SENSORS, "elbow", SensorModel(**changed))
    with pytest.raises(ConfigError, match=r"rate of elbow: got 100, .*physics.free_hz \(240\)"):
        FactoryConfig()
