"""Policies, robots, object sets and sensors of users' files: made, replayed, repaired, refused."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from support.helpers import assert_same_tree
from support.places import REPOSITORY
from support.plugin_files import FILES, OPTIONS, forget_plugins, write_plugins
from support.scale import sampled

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import Episode
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.factory.generate import generate
from grasp_factory.writers.zarr.embedded import read_embedded

pytestmark = pytest.mark.slow

SMALL = ("--resolution", "32x24", "--set", "block_size=1", "--set", "motion.hold_s=0.1")
MINE = tuple(word for option in OPTIONS.items() for word in option)
GIVEN = tuple(word for file in FILES for word in ("--plugin", file))


def command(folder: Path, *words: object, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run the command in a folder, in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "grasp_factory", *map(str, words)],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(REPOSITORY)} | variables,
        capture_output=True,
        text=True,
        check=False,
    )


def making(out: str, n: int = 2) -> tuple[object, ...]:
    """Return the words of a command that makes a small store."""
    return ("generate", "--n", n, "--quiet", "--out", out, *SMALL)


def make(folder: Path, out: str, *words: object, n: int = 2) -> subprocess.CompletedProcess[str]:
    return command(folder, *making(out, n), *words)


def line_of(done: subprocess.CompletedProcess[str], code: int) -> str:
    """Return the only line that a command says when it fails."""
    assert done.returncode == code, done.stderr
    lines = [line for line in done.stderr.splitlines() if line.startswith("Error: ")]
    assert len(lines) == 1, done.stderr
    assert "Traceback" not in done.stderr
    return lines[0]


def com(episode: Episode) -> NDArray[np.float64]:
    """Return the positions of the target's frame, which is in its middle, (n_steps, 3), m."""
    return episode.streams["object_pose"][:, 0, :3].astype(np.float64)


Here = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def command_here(run: Callable[..., tuple[int, str, str]], monkeypatch: pytest.MonkeyPatch) -> Here:
    """Return what runs the command in a folder and in this process, which forgets all plugins."""

    def command_here(folder: Path, *words: object) -> subprocess.CompletedProcess[str]:
        monkeypatch.chdir(folder)
        forget_plugins()
        return subprocess.CompletedProcess([], *run(*words))

    return command_here


@pytest.fixture(autouse=True)
def forgotten() -> Iterator[None]:
    """Forget the plugins of each test."""
    yield
    forget_plugins()


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the files and ``a.zarr``, made from all three with two workers."""
    folder = write_plugins(tmp_path_factory.mktemp("made"))
    done = make(folder, "a.zarr", *MINE, "--workers", 2)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture
def here(made: Path, tmp_path: Path) -> Path:
    """Return a copy of that folder."""
    return Path(shutil.copytree(made, tmp_path / "here"))


@pytest.fixture
def elsewhere(made: Path, tmp_path: Path) -> Path:
    """Return a folder with the store, but without the files."""
    (tmp_path / "elsewhere").mkdir()
    shutil.copytree(made / "a.zarr", tmp_path / "elsewhere" / "a.zarr")
    return tmp_path / "elsewhere"


def test_policy_robot_object_set_and_sensor_make_the_episodes(made: Path) -> None:
    for episode in Dataset(made / "a.zarr"):
        assert episode.spec.policy == "my_policy_plan"
        assert episode.spec.robot == "turned"
        assert episode.spec.objects[0].object_id.startswith("bricks/")
        assert episode.streams["joint_positions"][0, 0] == pytest.approx(0.3, abs=0.01)
        proximity = episode.streams["proximity"]
        assert proximity.shape == (episode.n_steps, 2)
        pads = np.linalg.norm(episode.streams["tcp_pose"][:, :3] - com(episode), axis=1)
        np.testing.assert_allclose(proximity.mean(axis=1), pads, atol=0.05)


@pytest.mark.parametrize("option", sampled(OPTIONS, 2))
def test_two_workers_and_this_process_make_the_same_bytes(option: str, here: Path) -> None:
    name = str(here / OPTIONS[option])
    mine: dict[str, dict[str, object]] = {
        "--policy": {"policies": {name: 1.0}},
        "--robot": {"robot": name},
        "--objects": {"object_sets": {name: 1.0}},
        "--sensor": {"sensors": {name: []}},
    }
    plain = FactoryConfig.from_plain(
        {
            "resolution": [32, 24], "block_size": 1, "motion": {"hold_s": 0.1}, **mine[option],
        }
    )  # fmt: skip
    generate(plain, 2, here / "one.zarr", workers=1)
    done = make(here, "two.zarr", option, OPTIONS[option], "--workers", 2)
    assert done.returncode == 0, done.stderr
    assert_same_tree(here / "one.zarr", here / "two.zarr")


def test_shards_make_the_store_together(here: Path) -> None:
    for k in (1, 2):
        done = make(here, "s.zarr", *MINE, "--shard", f"{k}/2")
        assert done.returncode == 0, done.stderr
    assert command(here, "verify", "s.zarr").returncode == 0
    checksums = [list(Dataset(here / name).column("checksum")) for name in ("a.zarr", "s.zarr")]
    assert checksums[0] == checksums[1]


def test_the_same_command_grows_the_store(here: Path) -> None:
    done = make(here, "a.zarr", *MINE, n=3)
    assert done.returncode == 0, done.stderr
    assert len(Dataset(here / "a.zarr").committed) == 3


def test_a_config_file_names_them_too(here: Path) -> None:
    text = "policies: {'my_policy.py:plan': 1}\nrobot: my_robot.py:ROBOT\n"
    (here / "my.yaml").write_text(
        text + "object_sets: {'my_set.py:SET': 1}\nsensors: ['my_sensor.py:PROXIMITY']\n"
    )
    done = make(here, "y.zarr", "--config", "my.yaml")
    assert done.returncode == 0, done.stderr
    assert_same_tree(here / "a.zarr", here / "y.zarr")


class TestReplay:
    def test_with_the_files(self, made: Path) -> None:
        done = command(made, "replay", "a.zarr", 1, *GIVEN)
        assert "replays to the same bytes" in done.stdout, done.stderr

    def test_with_trust_where_the_files_never_were(self, elsewhere: Path) -> None:
        done = command(elsewhere, "replay", "a.zarr", 1, "--trust", "--json")
        assert json.loads(done.stdout)["same"], done.stderr
        assert "running my_policy.py of a.zarr (SHA-256 " in done.stderr

    def test_without_either_it_names_what_to_add(self, made: Path, command_here: Here) -> None:
        line = line_of(command_here(made, "replay", "a.zarr", 1), 2)
        assert "policy my_policy_plan" in line
        assert line.endswith(
            "add --plugin my_policy.py --plugin my_robot.py --plugin my_set.py"
            " --plugin my_sensor.py, or --trust to run the copy in the store"
        )

    def test_with_a_file_that_has_changed(self, here: Path, command_here: Here) -> None:
        with (here / "my_policy.py").open("a") as file:
            file.write("# another\n")
        line = line_of(command_here(here, "replay", "a.zarr", 1, *GIVEN), 2)
        assert "my_policy.py has changed: policy my_policy_plan was made with the SHA-256" in line


def test_verify_simulates_again_only_with_the_files(elsewhere: Path, command_here: Here) -> None:
    assert command_here(elsewhere, "verify", "a.zarr").returncode == 0
    line_of(command_here(elsewhere, "verify", "a.zarr", "--deep", 1), 2)
    done = command_here(elsewhere, "verify", "a.zarr", "--deep", 1, "--trust")
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_damaged_episode_is_repaired_with_trust(
    elsewhere: Path, made: Path, command_here: Here
) -> None:
    (elsewhere / "a.zarr/streams/phase/1.0").unlink()
    line_of(command_here(elsewhere, "repair", "a.zarr"), 2)
    done = command_here(elsewhere, "repair", "a.zarr", "--trust")
    assert "1 episode simulated again with the same bytes" in done.stdout, done.stderr
    assert_same_tree(elsewhere / "a.zarr", made / "a.zarr")


def test_merging_and_exporting_carry_the_source_and_run_nothing(
    elsewhere: Path, command_here: Here
) -> None:
    assert command_here(elsewhere, "split", "a.zarr", "b.zarr", "--episodes", "0").returncode == 0
    done = command_here(elsewhere, "export", "b.zarr", "out", "--to", "sequences")
    assert done.returncode == 0, done.stderr
    done = command_here(elsewhere, "import", "out", "c.zarr")
    assert done.returncode == 0, done.stderr
    for name in ("b.zarr", "c.zarr"):
        origin = Dataset(elsewhere / name).config.plugins["policies"]["my_policy_plan"]
        content = read_embedded(elsewhere / name, f"plugins/{origin.sha256}")
        assert content == FILES["my_policy.py"].encode()


def test_info_shows_the_source_with_escapes(tmp_path: Path) -> None:
    hostile = FILES["my_policy.py"] + "# \x1b[2J\n"
    (tmp_path / "my_policy.py").write_text(hostile)
    assert make(tmp_path, "a.zarr", "--policy", "my_policy.py:plan", n=1).returncode == 0
    said = command(tmp_path, "info", "a.zarr", "--full").stdout
    assert "policy my_policy_plan  my_policy.py:plan  SHA-256 " in said
    assert "    def plan(" in said
    assert "# \\x1b[2J" in said
    assert "\x1b" not in said


def test_a_run_with_a_changed_file_is_another_dataset(here: Path, command_here: Here) -> None:
    with (here / "my_policy.py").open("a") as file:
        file.write("# another\n")
    line = line_of(command_here(here, *making("a.zarr"), *MINE), 2)
    assert "my_policy.py has changed since a.zarr was begun; choose another --out" in line


BROKEN = {
    "missing": (None, "my_policy.py is not there, valid: the path of a file that ends in .py"),
    "no name": ("x = 1\n", "has no 'plan' (valid: x)"),
    "a syntax error": ("def plan(:\n", "cannot be loaded: SyntaxError: invalid syntax (line 1)"),
    "an error": (
        "import numpy\nprint(Params)\n",
        "cannot be loaded: NameError: name 'Params' is not defined (line 2)",
    ),
    "an exit": ("import sys\nsys.exit(3)\n", "cannot be loaded: SystemExit: 3 (line 2)"),
    "arguments": ("def plan(view): ...\n", "takes (view), valid: (view, rng, settings)"),
    "a number": ("plan = 3\n", "is no policy: got 3, valid: a function plan(view, rng, settings)"),
    "too large": (f"#{'x' * 300_000}\n", "the source of a plugin of 262.1 kB, valid: up to"),
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_file_that_cannot_be_used_is_one_line(
    what: str, tmp_path: Path, command_here: Here
) -> None:
    text, said = BROKEN[what]
    if text is not None:
        (tmp_path / "my_policy.py").write_text(text)
    done = command_here(tmp_path, *making("a.zarr"), "--policy", "my_policy.py:plan")
    code = 1 if what == "too large" else 2
    assert said in line_of(done, code)
    assert not (tmp_path / "a.zarr").exists()


SENSOR_FAULTS = {
    "an error": (
        "target, _ =",
        "raise ValueError('no signal')\n        target, _ =",
        "ValueError: no",
    ),
    "a shape": (
        "reshape(-1, 2)",
        "reshape(-1)",
        "sensor proximity: streams/proximity: got float32 (",
    ),
    "a type": ("np.float32)", "np.int64)", "sensor proximity: streams/proximity: got int64 ("),
    "a name": ('{"proximity":', '{"nearness":', "got ['nearness'], valid: proximity"),
    "a value": ("pad, target)", "pad, np.inf)", "streams/proximity not finite"),
}


@pytest.mark.parametrize("what", SENSOR_FAULTS)
def test_a_sensor_that_fails_quarantines_its_episodes(what: str, tmp_path: Path) -> None:
    text, fault, said = SENSOR_FAULTS[what]
    assert text in FILES["my_sensor.py"]
    (tmp_path / "my_sensor.py").write_text(FILES["my_sensor.py"].replace(text, fault))
    name = f"{tmp_path}/my_sensor.py:PROXIMITY"
    plain = {"resolution": [32, 24], "sensors": {name: []}, "motion": {"hold_s": 0.1}}
    generate(FactoryConfig.from_plain(plain), 1, tmp_path / "a.zarr", workers=1, max_failures=1)
    (error,) = Dataset(tmp_path / "a.zarr").column("error")
    assert said in error


SENSOR_REFUSALS = {
    "taken": (
        '.series("proximity"',
        '.series("wrist_wrench"',
        "sensors.name: got 'wrist_wrench', valid: a name that no array has",
    ),
    "foreign": (
        '.series("proximity"',
        '.series("other"',
        "valid: proximity, or a name that begins",
    ),
    "lettered": ('(2,), "float32"', '("J",), "float32"', "with numbers as SHAPE"),
    "huge": ('(2,), "float32"', '(2**40,), "float32"', "and 4096 values in a record"),
    "own": ('name="proximity"', 'name="wrist"', "sensors: got 'wrist', valid: names that the"),
}


@pytest.mark.parametrize("what", SENSOR_REFUSALS)
def test_a_sensor_whose_arrays_no_store_can_have_is_one_line(
    what: str, tmp_path: Path, command_here: Here
) -> None:
    text, fault, said = SENSOR_REFUSALS[what]
    assert text in FILES["my_sensor.py"]
    (tmp_path / "my_sensor.py").write_text(FILES["my_sensor.py"].replace(text, fault))
    done = command_here(tmp_path, *making("a.zarr"), "--sensor", "my_sensor.py:PROXIMITY")
    assert said in line_of(done, 2)
    assert not (tmp_path / "a.zarr").exists()


def test_sensors_of_this_package_need_no_option(tmp_path: Path, command_here: Here) -> None:
    for name, said in (("wrist", "which always record"), ("sonar", "FILE.py:NAME, or a sensor of")):
        assert said in line_of(command_here(tmp_path, *making("a.zarr"), "--sensor", name), 2)


def test_the_checks_of_a_sensor_find_one_that_moves_the_arm(tmp_path: Path) -> None:
    text = FILES["my_sensor.py"].replace(
        "target, _ =", "tick.scene.world.step()\n        target, _ ="
    )
    (tmp_path / "my_sensor.py").write_text(text)
    done = command(tmp_path, "conformance", "my_sensor.py:PROXIMITY")
    assert done.returncode == 1
    assert "FAILED  it changes no other array" in done.stdout, done.stdout + done.stderr
    assert "passed  the same recipe gives the same values" in done.stdout


def test_a_policy_that_raises_quarantines_its_episodes(tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text("def plan(view, rng, settings):\n    raise ValueError('no')\n")
    done = make(tmp_path, "a.zarr", "--policy", "bad.py:plan", "--max-failures", 1)
    assert done.returncode == 0, done.stderr
    reason = "PolicyError: policy bad_plan raises ValueError: no"
    assert list(Dataset(tmp_path / "a.zarr").column("error")) == [reason] * 2


def test_what_a_file_prints_is_on_stderr(tmp_path: Path) -> None:
    loud = f"print('loaded')\n{FILES['my_policy.py']}".replace(
        "points =", "print('planning')\n    points ="
    )
    (tmp_path / "my_policy.py").write_text(loud)
    words = ("--policy", "my_policy.py:plan", "--json", "--workers", 2)
    done = make(tmp_path, "a.zarr", *words)
    assert json.loads(done.stdout)["made"] == 2
    assert "loaded" in done.stderr
    assert "planning" in done.stderr


def test_the_name_of_a_row_of_this_package_is_refused(tmp_path: Path, command_here: Here) -> None:
    text = FILES["my_robot.py"].replace('"turned"', '"panda"')
    (tmp_path / "my_robot.py").write_text(text)
    line = line_of(command_here(tmp_path, *making("a.zarr"), "--robot", "my_robot.py:ROBOT"), 2)
    assert "my_robot.py:ROBOT has the name 'panda', which is one of this package" in line


def evil_store(made: Path, folder: Path) -> Path:
    """Return a store that carries code which writes a file as it is run."""
    text = f"open({str(folder / 'owned')!r}, 'w').close()\n{FILES['my_policy.py']}"
    shutil.copytree(made, folder, dirs_exist_ok=True)
    (folder / "my_policy.py").write_text(text)
    done = make(folder, "evil.zarr", "--policy", "my_policy.py:plan")
    assert done.returncode == 0, done.stderr
    (folder / "owned").unlink()
    return folder


NEVER = (
    "info evil.zarr", "verify evil.zarr", "query evil.zarr --csv", "card evil.zarr --out card",
    "split evil.zarr part.zarr --episodes 0", "merge merged.zarr evil.zarr", "tags evil.zarr",
    "export evil.zarr coco --to coco", "sheet evil.zarr sheet.png", "index evil.zarr",
)  # fmt: skip
"""What reads a store, and runs none of its code."""
REFUSED = (
    "replay evil.zarr 0", "repair evil.zarr", "verify evil.zarr --deep 1",
    "replay evil.zarr 0 --video video.mp4",
)  # fmt: skip
"""What needs the code, and ends without it."""


def test_code_of_a_store_is_run_by_no_command_without_trust(
    made: Path, tmp_path: Path, command_here: Here
) -> None:
    folder = evil_store(made, tmp_path / "evil")
    (folder / "my_policy.py").unlink()
    for line in NEVER:
        done = command_here(folder, *line.split())
        assert done.returncode == 0, done.stderr
        assert not (folder / "owned").exists(), line
    (folder / "evil.zarr/streams/phase/1.0").unlink()
    for line in REFUSED:
        assert "my_policy.py, which was not given" in line_of(
            command_here(folder, *line.split()), 2
        )
        assert not (folder / "owned").exists(), line
    command_here(folder, "replay", "evil.zarr", 0, "--trust")
    assert (folder / "owned").exists()
