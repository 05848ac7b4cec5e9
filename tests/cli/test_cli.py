"""The command as a user meets it: what it prints, how it exits, and that it stops when told to."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import re
import shutil
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import pytest
import yaml
from support.helpers import tree
from support.places import REPOSITORY
from support.scale import soak_only

from grasp_factory import __version__
from grasp_factory.__main__ import main
from grasp_factory.cli import main as cli
from grasp_factory.cli import run_progress
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import RecipeError, StoreError
from grasp_factory.factory import block_maker, generate
from grasp_factory.factory.run_request import resolve_request
from grasp_factory.objects import OBJECT_SETS
from grasp_factory.policies import POLICIES
from grasp_factory.robots import ROBOTS

COMMAND = [sys.executable, "-m", "grasp_factory"]
TINY = ("--resolution", "32x24", "--set", "block_size=1")


@dataclass(frozen=True)
class Result:
    code: int
    out: str
    err: str


Run = Callable[..., Result]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Run:
    """Run the command in this process, in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def run(*args: object) -> Result:
        monkeypatch.setattr(sys, "argv", ["grasp-factory", *map(str, args)])
        with pytest.raises(SystemExit) as left:
            main()
        out, err = capsys.readouterr()
        assert isinstance(left.value.code, int)
        return Result(left.value.code, out, err)

    return run


@pytest.fixture
def inline(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make episodes in this process, not in one that has to start."""

    def here(*args: Any, episode_timeout: float, **more: Any) -> Any:
        return generate.generate(*args, **more)

    monkeypatch.setattr(run_progress, "generate", here)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four real episodes in tiny images."""
    path = tmp_path_factory.mktemp("cli") / "ds.zarr"
    generate.generate(FactoryConfig(resolution=(32, 24)), 4, path, workers=1)
    return path


def one_line(text: str) -> str:
    """Return the one line that an error should be."""
    assert text.startswith("Error: ")
    assert text.count("\n") == 1
    return text


class TestGenerate:
    @pytest.mark.slow
    def test_makes_a_store_and_prints_a_summary(self, run: Run) -> None:
        result = run("generate", "--n", 2, "--workers", 1, "--out", "ds.zarr", *TINY)
        assert result.code == 0
        assert len(Dataset("ds.zarr").committed) == 2
        assert "Making 2 episodes of kuka_iiwa at 32x24, seed 0, with 1 worker" in result.err
        assert "2 episodes made in " in result.out
        assert "ds.zarr: 2 episodes, " in result.out
        for word in ("policy", "outcome", "success"):
            assert word in result.out

    def test_says_when_there_is_nothing_to_do(self, run: Run, store: Path) -> None:
        before = tree(store.parent)
        result = run("generate", "--n", 4, "--out", store, "--resolution", "32x24")
        assert result.code == 0
        assert "is complete: 4 episodes." in result.err
        assert "0 episodes made, 4 were already there" in result.out
        assert tree(store.parent) == before

    def test_counts_what_is_there_of_what_is_asked_for(
        self, run: Run, store: Path, tmp_path: Path
    ) -> None:
        larger = shutil.copytree(store, tmp_path / "larger.zarr")
        result = run("generate", "--n", 3, "--out", larger, "--resolution", "32x24")
        assert result.code == 0
        assert "larger.zarr already has the 3 episodes of this run" in result.err

    def test_gives_scripts_json_and_nothing_else_on_stdout(self, run: Run, store: Path) -> None:
        result = run("generate", "--n", 4, "--out", store, "--resolution", "32x24", "--json")
        summary = json.loads(result.out)
        assert (summary["made"], summary["already_there"]) == (0, 4)
        assert summary["store"]["committed"] == 4

    def test_is_silent_when_asked_to(self, run: Run, store: Path) -> None:
        result = run("generate", "--n", 4, "--out", store, "--resolution", "32x24", "--quiet")
        assert (result.code, result.out, result.err) == (0, "", "")

    @pytest.mark.usefixtures("inline")
    def test_shows_no_bar_where_stderr_is_no_terminal(self, run: Run) -> None:
        result = run("generate", "--n", 1, "--workers", 1, *TINY)
        assert "%|" not in result.err
        assert result.err.count("\n") == 1

    @pytest.mark.usefixtures("inline")
    def test_writes_to_grasps_zarr_unless_told_otherwise(self, run: Run) -> None:
        assert run("generate", "--n", 1, "--workers", 1, *TINY).code == 0
        assert Path("grasps.zarr").is_dir()

    @pytest.mark.usefixtures("inline")
    def test_reports_a_quarantined_episode(self, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
        def fail(world: Any, spec: Any) -> Any:
            raise RecipeError("too heavy")

        monkeypatch.setattr(block_maker, "run_episode", fail)
        result = run("generate", "--n", 1, "--workers", 1, "--max-failures", 1, *TINY)
        assert result.code == 0
        assert "episode 0 is quarantined: too heavy" in result.err
        assert "episode 0 is quarantined: too heavy" in result.out
        result = run("generate", "--n", 1, "--workers", 1, *TINY)
        assert result.code == 1
        assert "1 of 1 episodes are quarantined, more than --max-failures 0.25" in result.err


class TestPrintConfig:
    def test_prints_the_settings_and_writes_nothing(self, run: Run, tmp_path: Path) -> None:
        result = run("generate", "--print-config")
        assert result.code == 0
        assert yaml.safe_load(result.out)["robot"] == "kuka_iiwa"
        assert list(tmp_path.iterdir()) == []

    def test_prints_what_can_be_fed_back(self, run: Run) -> None:
        flags = ["--n", 7, "--seed", 3, "--workers", 1, "--out", "a.zarr", "--robot", "panda",
                 "--policy", "uniform:2", "--policy", "top_down", "--objects", "classic",
                 "--resolution", "64x48", "--record-hz", 60, "--set", "motion.grip_force=30",
                 "--set", "cameras.front.fov_y_deg=50"]  # fmt: skip
        first = run("generate", "--print-config", *flags)
        Path("c.yaml").write_text(first.out)
        assert run("generate", "--print-config", "--config", "c.yaml").out == first.out
        request = resolve_request(yaml.safe_load(first.out), {})
        config = request.config
        assert (request.n, request.workers, str(request.out)) == (7, 1, "a.zarr")
        assert (config.seed, config.robot, config.record_hz) == (3, "panda", 60)
        assert config.policies == {"uniform": 2.0, "top_down": 1.0}
        assert config.object_sets == {"classic": 1.0}
        assert config.resolution == (64, 48)
        assert config.motion.grip_force == 30.0
        assert config.cameras["front"].fov_y_deg == 50.0

    def test_lets_flags_win_over_the_file(self, run: Run) -> None:
        Path("c.yaml").write_text("n: 9\nseed: 1\nworkers: 3\n")
        result = run("generate", "--config", "c.yaml", "--seed", 2, "--print-config")
        settings = yaml.safe_load(result.out)
        assert (settings["n"], settings["seed"], settings["workers"]) == (9, 2, 3)

    def test_checks_names_like_a_run(self, run: Run) -> None:
        assert run("generate", "--print-config", "--robot", "kuka").code == 2


WRONG = [
    (["--n", "0"], "n: got 0, valid: an integer from 1 to 1000000"),
    (["--n", "-3"], "n: got -3, valid"),
    (["--n", "many"], "'--n': 'many' is not a valid integer"),
    (["--n", "9" * 30], "n: got 999999999999999999999999999999, valid"),
    (["--seed", "-1"], "seed: got -1, valid: 0 to"),
    (["--workers", "0"], "workers: got 0, valid: an integer from 1 to"),
    (["--resolution", "640"], "'--resolution': '640': expected WIDTHxHEIGHT"),
    (["--resolution", "1x1"], "resolution: got [1, 1], valid: 16 to 4096 pixels"),
    (["--record-hz", "50"], "record_hz: got 50, valid: a divisor of"),
    (["--robot", "kuka"], "unknown robot 'kuka'; did you mean 'kuka_iiwa'? (valid: "),
    (["--policy", "topdown"], "unknown policy 'topdown'; did you mean 'top_down'? (valid: "),
    (["--policy", "uniform:much"], "'--policy': got 'uniform:much', valid: NAME or NAME:WEIGHT"),
    (["--policy", "uniform:0"], "policies: got {'uniform': 0.0}, valid: names with weights"),
    (["--objects", "blob"], "unknown object set 'blob'; did you mean 'blobs'? (valid: "),
    (["--set", "motion.gripforce=1"], "unknown key 'motion.gripforce'; did you mean 'grip_force'"),
    (["--set", "seed"], "--set 'seed': expected KEY=VALUE"),
    (["--config", "absent.yaml"], "config file absent.yaml cannot be read"),
    (["--config", "typo.yaml"], "unknown key 'wokers'; did you mean 'workers'? (valid: n, "),
    (["--out", "file.txt"], "file.txt is a file, not a grasp-factory store"),
    (["--out", "folder"], "folder is not a grasp-factory store"),
    (["--out", "absent/ds.zarr"], "absent/ds.zarr cannot be written"),
    (["--out", ""], "out: got '', valid: a path"),
    (["--out", "/"], "/ is the root directory, no store; choose another path"),
    (["--out", "loop"], "loop cannot be used: Too many levels of symbolic links"),
    (["--out", "loop/x.zarr"], "loop/x.zarr cannot be used: Too many levels of symbolic links"),
    (["--out", "b/" * 3000], "cannot be used: File name too long; choose another path"),
    (["--set", r'out="a\0b"'], r"a\x00b cannot be used: "),
    (["--out", "locked.zarr"], ".locked.zarr.grasp-factory.lock is in the way: it is no lock of"),
    (
        ["--out", "noted.zarr"],
        "noted.zarr.runs.jsonl is in the way: it is no regular file; move it",
    ),
    (["--set", "seed=2001-99-99"], "--set 'seed=2001-99-99': '2001-99-99' is not valid YAML: "),
    (["--set", "seed=!!int foo"], "'!!int foo' is not valid YAML: invalid literal for int()"),
    (["--config", "twice.yaml"], "line 2: key 'seed' is there twice; keep one of them"),
    (["--bogus"], "No such option"),
    (["extra"], "unexpected extra argument"),
]


@pytest.mark.parametrize(("args", "text"), WRONG, ids=[" ".join(w[0])[:40] for w in WRONG])
def test_a_mistake_is_one_line_and_exit_2_and_nothing_is_written(
    run: Run, tmp_path: Path, args: list[str], text: str
) -> None:
    Path("file.txt").write_text("mine")
    Path("folder").mkdir()
    Path("folder/file.txt").write_text("mine")
    Path("typo.yaml").write_text("wokers: 3")
    Path("twice.yaml").write_text("seed: 3\nseed: 4")
    Path("loop").symlink_to("loop")
    Path(".locked.zarr.grasp-factory.lock").write_text("mine")
    Path("noted.zarr.runs.jsonl").mkdir()
    before, names = tree(tmp_path), sorted(tmp_path.rglob("*"))
    result = run("generate", "--n", "1", "--workers", "1", *args)
    assert result.code == 2
    assert text in one_line(result.err)
    assert len(result.err) < 1200
    assert result.out == ""
    assert (tree(tmp_path), sorted(tmp_path.rglob("*"))) == (before, names)


def test_a_store_of_another_config_is_refused(run: Run, store: Path) -> None:
    result = run("generate", "--n", 9, "--out", store, "--resolution", "32x24", "--seed", 5)
    assert result.code == 2
    assert "it has seed: 0, and this run has 5" in one_line(result.err)


class TestInfo:
    def test_fits_a_screen(self, run: Run, store: Path) -> None:
        result = run("info", store)
        assert result.code == 0
        lines = result.out.splitlines()
        assert len(lines) <= 24
        assert max(map(len, lines[1:])) <= 80
        for words in ("4 episodes", "% success", "outcome", "policy", "family", "split"):
            assert words in result.out

    def test_tells_people_what_a_store_holds(self, run: Run, store: Path) -> None:
        result = run("info", store, "--full")
        assert result.code == 0
        for words in ("4 episodes", "% success", "policy", "outcome", "object set", "split",
                      "cameras/front/rgb", "4 x 2 x 24 x 32 x 3", "uint8", "rad/s", "kuka_iiwa",
                      "pybullet"):  # fmt: skip
            assert words in result.out

    def test_tells_scripts_the_same(self, run: Run, store: Path) -> None:
        facts = json.loads(run("info", store, "--json").out)
        assert (facts["episodes"], facts["committed"], facts["quarantined"]) == (4, 4, 0)
        arrays = {a["path"]: a for a in facts["arrays"]}
        assert arrays["cameras/front/depth"] == {
            "path": "cameras/front/depth", "shape": [4, 2, 24, 32], "dtype": "float32", "units": "m"
        }  # fmt: skip
        assert facts["attributes"]["config"] == Dataset(store).config.to_plain()

    @pytest.mark.parametrize("path", ["absent", "file.txt"])
    def test_refuses_what_is_no_store(self, run: Run, path: str) -> None:
        Path("file.txt").write_text("mine")
        result = run("info", path)
        assert result.code == 2
        assert path in one_line(result.err)


class TestReplay:
    def test_of_the_same_bytes_exits_with_0(self, run: Run, store: Path) -> None:
        result = run("replay", store, 1)
        assert result.code == 0
        assert "replays to the same bytes" in result.out

    def test_of_other_bytes_exits_with_1_and_names_the_array(
        self, run: Run, store: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        from grasp_factory.curation import replay

        other = Dataset(store)[2]
        monkeypatch.setattr(replay, "run_episode", lambda world, spec: other)
        result = run("replay", store, 1, "--json")
        assert result.code == 1
        facts = json.loads(result.out)
        assert facts["same"] is False
        assert facts["difference"].startswith("cameras/front/depth: ")
        text = run("replay", store, 1)
        assert text.code == 1
        assert "does not replay to the same bytes" in text.out
        assert "fingerprint and versions are the recording's, so the bytes should be" in text.out

    @pytest.mark.parametrize("index", [4, "x"])
    def test_of_no_episode_exits_with_2(self, run: Run, store: Path, index: object) -> None:
        result = run("replay", store, index)
        assert result.code == 2
        one_line(result.err)


class TestSheet:
    def test_writes_a_picture(self, run: Run, store: Path) -> None:
        result = run("sheet", store, "s.png")
        assert (result.code, result.out) == (0, "s.png\n")
        assert cv2.imread("s.png") is not None

    def test_draws_the_episodes_that_are_asked_for(self, run: Run, store: Path) -> None:
        run("sheet", store, "one.png", "--episodes", "2", "--camera", "front")
        run("sheet", store, "two.png", "--episodes", "2,0")
        one, two = cv2.imread("one.png"), cv2.imread("two.png")
        assert one is not None
        assert two is not None
        assert two.shape[0] > one.shape[0]

    @pytest.mark.parametrize(
        "args",
        [["s.jpg"], ["no/s.png"], ["s.png", "--episodes", "9"], ["s.png", "--episodes", "a"],
         ["s.png", "--camera", "frnt"]],
    )  # fmt: skip
    def test_refuses_what_cannot_be_drawn(self, run: Run, store: Path, args: list[str]) -> None:
        result = run("sheet", store, *args)
        assert result.code == 2
        one_line(result.err)


@pytest.mark.parametrize(
    ("command", "table"),
    [("robots", ROBOTS), ("policies", POLICIES), ("objects", OBJECT_SETS)],
)
def test_a_table_is_listed_with_its_descriptions(run: Run, command: str, table: Any) -> None:
    text, facts = run(command).out, json.loads(run(command, "--json").out)
    assert list(facts) == list(table)
    assert len(text.splitlines()) == len(table)
    for name, row in table.items():
        assert name in text
        assert row.description in text
        assert facts[name] == row.description


def test_an_unknown_command_is_answered_with_the_nearest_and_all(run: Run) -> None:
    result = run("genrate")
    assert result.code == 2
    text = one_line(result.err)
    assert "unknown command 'genrate'; did you mean 'generate'? (valid: " in text
    assert all(command in text for command in cli.cli.commands)


def test_info_lists_the_arrays_of_the_schema_and_labels_and_nothing_strange(
    run: Run, store: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "copy.zarr"
    shutil.copytree(store, copy)
    (copy / "extra").mkdir()
    (copy / "extra/zarr.json").write_text("broken")
    assert run("relabel", copy, "--name", "strict", "--min-lift", 0.12).code == 0
    before = json.loads(run("info", store, "--json").out)["arrays"]
    after = json.loads(run("info", copy, "--json").out)["arrays"]
    more = [row["path"] for row in after if row not in before]
    assert more == ["labels/strict/outcome", "labels/strict/success"]


@pytest.mark.slow
@pytest.mark.parametrize("closed", [*soak_only("<&-", "2>&-"), ">&-", "<&- >&- 2>&-"])
def test_closed_streams_are_no_failure(store: Path, closed: str) -> None:
    command = f"'{sys.executable}' -m grasp_factory info '{store}' {closed}"
    done = subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, cwd=REPOSITORY, check=False
    )
    assert done.returncode == 0
    assert done.stderr == ""
    assert (done.stdout == "") is (" >" in f" {closed}")


def test_workers_inherit_what_stands_for_a_closed_stdout() -> None:
    code = (
        "import os, sys; from grasp_factory import __main__ as program;"
        " program._open_standard_streams(); sys.exit(0 if os.get_inheritable(1) else 3)"
    )
    command = f"'{sys.executable}' -c '{code}' >&-"
    done = subprocess.run(["bash", "-c", command], cwd=REPOSITORY, check=False)
    assert done.returncode == 0


def test_a_path_that_is_no_text_is_printed_with_escapes(store: Path, tmp_path: Path) -> None:
    path = os.fsencode(tmp_path) + b"/n\xff.zarr"
    os.symlink(store, path)
    done = subprocess.run(
        [*COMMAND, "info", path], capture_output=True, text=True, cwd=REPOSITORY, check=False,
        env=os.environ | {"PYTHONIOENCODING": "utf-8:strict"},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert r"n\udcff.zarr: 4 episodes" in done.stdout


def test_the_version_is_the_packages(run: Run) -> None:
    assert __version__ in run("--version").out


def test_without_a_command_the_help_is_shown(run: Run) -> None:
    result = run()
    assert result.code == 0
    assert result.out == run("--help").out
    for command in cli.cli.commands:
        assert command in result.out


def test_the_help_of_generate_tells_the_true_defaults(run: Run) -> None:
    text = " ".join(run("generate", "--help").out.split())
    config = FactoryConfig()
    assert "[default: those of the store at --out, or 50]" in text
    for value in ("0", "2", "grasps.zarr", config.robot, "640x480", str(config.record_hz)):
        assert f"[default: {value}]" in text


def test_help_loads_neither_the_simulator_nor_the_store() -> None:
    code = (
        "import sys; from grasp_factory.cli.main import cli; cli(['generate', '--help'], 'x', "
        "standalone_mode=False); print({'pybullet', 'zarr', 'cv2', 'numpy'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=REPOSITORY
    )
    assert done.stdout.splitlines()[-1] == "set()"


def test_a_failure_that_is_no_mistake_exits_with_1(
    run: Run, store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any) -> Any:
        raise StoreError("the store is damaged\nbadly")

    monkeypatch.setattr(Dataset, "__init__", fail)
    result = run("info", store)
    assert (result.code, result.err) == (1, "Error: the store is damaged badly\n")


def test_a_bug_keeps_its_traceback(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Dataset, "__init__", lambda self, path: 1 / 0)
    monkeypatch.setattr(sys, "argv", ["grasp-factory", "info", str(store)])
    with pytest.raises(ZeroDivisionError):
        main()


def test_a_full_disk_is_one_line(store: Path) -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*COMMAND, "info", str(store)],
            stdout=full, stderr=subprocess.PIPE, text=True, cwd=REPOSITORY, check=False,
        )  # fmt: skip
    assert done.returncode == 1
    assert "No space left on device" in one_line(done.stderr)


def test_a_reader_that_leaves_early_is_met_with_silence(store: Path) -> None:
    process = subprocess.Popen(
        [*COMMAND, "info", str(store)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=REPOSITORY,
    )
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    assert process.stderr.read() == b""
    assert process.wait() == 1
    process.stderr.close()


@pytest.mark.slow
class TestALongRun:
    """A real command in its own process group, as a terminal would start it."""

    @pytest.fixture(autouse=True)
    def interruptible(self) -> Iterator[None]:
        """Let children take Ctrl-C, even where this process, in a shell's background, does not."""
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        yield
        signal.signal(signal.SIGINT, before)

    @pytest.fixture
    def out(self, tmp_path: Path) -> Path:
        return tmp_path / "ds.zarr"

    @pytest.fixture
    def process(self, out: Path) -> Iterator[subprocess.Popen[str]]:
        process = subprocess.Popen(
            [*COMMAND, "generate", "--n", "300", "--workers", "2", "--out", str(out), *TINY],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=REPOSITORY,
            start_new_session=True,
        )
        yield process
        process.kill()
        process.communicate()

    def wait_for_episodes(self, out: Path, process: subprocess.Popen[str]) -> None:
        deadline = time.monotonic() + 60.0
        while not out.exists() or len(Dataset(out).committed) < 3:
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.05)

    def check_that_it_goes_on(self, out: Path) -> None:
        dataset = Dataset(out)
        kept = dataset.committed.tolist()
        assert 3 <= len(kept) < 300
        assert all(dataset.verify(i) for i in kept)
        before = {i: str(dataset.column("checksum")[i]) for i in kept}
        n = max(kept) + 2
        config = FactoryConfig(resolution=(32, 24), block_size=1)
        assert generate.generate(config, n, out, workers=1).already_there == len(kept)
        after = Dataset(out)
        assert after.committed.tolist() == list(range(n))
        assert {i: str(after.column("checksum")[i]) for i in kept} == before

    @pytest.mark.slow
    def test_stops_at_ctrl_c_and_says_how_to_go_on(
        self, out: Path, process: subprocess.Popen[str]
    ) -> None:
        self.wait_for_episodes(out, process)
        os.killpg(process.pid, signal.SIGINT)
        stdout, stderr = process.communicate(timeout=120)
        assert process.returncode == 130
        assert stdout == ""
        first, last = stderr.splitlines()
        assert first.startswith("Making 300 episodes")
        assert re.fullmatch(
            rf"Stopped: [0-9]+ episodes? (is|are) in {re.escape(str(out))}"
            r"(, [0-9]+ of unfinished blocks (is|are) discarded)?"
            r"; run the same command again to continue\.",
            last,
        )
        self.check_that_it_goes_on(out)

    @pytest.mark.soak
    def test_stops_at_sigterm_like_at_ctrl_c_with_its_own_exit_code(
        self, out: Path, process: subprocess.Popen[str]
    ) -> None:
        self.wait_for_episodes(out, process)
        process.terminate()
        process.terminate()  # `timeout` sends it twice
        stdout, stderr = process.communicate(timeout=120)
        assert process.returncode == 143
        assert stdout == ""
        assert stderr.splitlines()[-1].startswith("Stopped: ")
        assert stderr.count("\n") == 2
        line = json.loads(out.with_name("ds.zarr.runs.jsonl").read_text())
        assert line["ended"] == "Terminated"
        assert sorted(path.name for path in out.parent.iterdir()) == [
            "ds.zarr",
            "ds.zarr.runs.jsonl",
        ]
        self.check_that_it_goes_on(out)

    @pytest.mark.soak
    @pytest.mark.slow
    def test_shows_each_episode_on_a_terminal(self, out: Path) -> None:
        pid, terminal = pty.fork()
        if pid == 0:
            fcntl.ioctl(1, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 100, 0, 0))
            os.chdir(REPOSITORY)
            command = [*COMMAND, "generate", "--n", "3", "--out", str(out), *TINY]
            os.execv(command[0], command)
        text = read_all(terminal)
        assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
        assert "0/3" in text
        assert "3/3" in text
        assert re.search(
            "(episode/s|s/episode), success ", text
        )  # a slow machine has the other unit
        assert "3 episodes made" in text


def read_all(terminal: int) -> str:
    data = b""
    while True:
        try:
            data += os.read(terminal, 65536)
        except OSError:  # the other end is closed
            os.close(terminal)
            return data.decode()
