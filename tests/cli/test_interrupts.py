"""Ctrl-C and SIGTERM at any instant: an exit code, a line, no worker left, and a store to go on."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from support.helpers import assert_same_tree
from support.scale import sampled, scaled

from grasp_factory.cli import run_progress
from grasp_factory.cli.signal_handling import RETRY_S
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.factory.generate import generate

N = 4
COMMAND = [
    *(sys.executable, "-m", "grasp_factory", "generate", "--n", str(N), "--seed", "3"),
    *("--resolution", "48x36", "--set", "block_size=2"),
]
CONFIG = FactoryConfig(seed=3, resolution=(48, 36), block_size=2)
INT, TERM = signal.SIGINT, signal.SIGTERM
PATIENCE_S = 120.0


@pytest.fixture(scope="module", autouse=True)
def interruptible() -> Iterator[None]:
    """Let children take Ctrl-C, even where this process, in a shell's background, ignores it."""
    before = signal.signal(INT, signal.default_int_handler)
    yield
    signal.signal(INT, before)


@pytest.fixture(scope="module")
def want(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("want") / "ds.zarr"
    complete(path)
    return path


def complete(out: Path) -> str:
    """Do what the command does, in this process; return what it would say."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        generate(CONFIG, N, out, workers=1)
    return "".join(f"Warning: {one.message}\n" for one in caught)


def complete_by_command(out: Path) -> str:
    """Run the command to its end; return what it said."""
    command = [*COMMAND, "--out", str(out), "--quiet"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")
    return done.stderr


@contextlib.contextmanager
def running(out: Path, workers: int) -> Iterator[subprocess.Popen[str]]:
    """Run the command in its own session, as a terminal would."""
    process = subprocess.Popen(
        [*COMMAND, "--out", str(out), "--workers", str(workers)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        wait(process, lambda: listens(process.pid))
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def wait(process: subprocess.Popen[str], is_so: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while process.poll() is None and not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.002)


def listens(pid: int) -> bool:
    """Say whether a process catches SIGTERM, which Python does not do by itself."""
    with contextlib.suppress(FileNotFoundError):
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("SigCgt:"):
                return bool(int(line.split()[1], 16) >> (TERM - 1) & 1)
    return False


def members(session: int) -> list[str]:
    """Return the processes of a session that run."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            state, _, _, its, *_ = (place / "stat").read_text().rpartition(")")[2].split()
            if int(its) == session and state != "Z":
                found.append(place.name)
    return found


def send(process: subprocess.Popen[str], what: signal.Signals, *, group: bool) -> None:
    with contextlib.suppress(ProcessLookupError):
        (os.killpg if group else os.kill)(process.pid, what)


def check_end(process: subprocess.Popen[str], out: Path, codes: set[int]) -> str:
    """Check all that holds of a stopped run; return what it said last."""
    stdout, stderr = process.communicate(timeout=PATIENCE_S)
    assert "Traceback" not in stderr
    assert "Exception" not in stderr
    assert process.returncode in codes, stderr
    assert stdout == "" or process.returncode == 0
    deadline = time.monotonic() + PATIENCE_S
    while left := members(process.pid):  # a worker that sees its parent gone needs a moment
        assert time.monotonic() < deadline, left
        time.sleep(0.02)
    if (out / "zarr.json").exists():
        dataset = Dataset(out)
        assert all(dataset.verify(i) for i in dataset.committed.tolist())
    return (stderr.splitlines() or [""])[-1]


def check_completion(out: Path, want: Path, how: Callable[[Path], str] = complete) -> None:
    said = how(out)
    assert said.count("\n") <= 1
    assert said == "" or said.startswith("Warning: a run that ended did not release")
    assert_same_tree(want, out)
    assert sorted(path.name for path in out.parent.iterdir()) == ["ds.zarr", "ds.zarr.runs.jsonl"]


def is_creating(out: Path) -> bool:
    return out.with_name(".ds.zarr.creating").exists() or (out / ".creating").exists()


def has_a_block(out: Path) -> bool:
    return (out / "episodes/status/0").exists()


ONCE = {
    "Ctrl-C during the creation": (INT, is_creating, 2, "Stopped: "),
    "Ctrl-C with a block in hand": (INT, has_a_block, 2, "Stopped: "),
    "SIGTERM with a block in hand": (TERM, has_a_block, 1, "Stopped: "),
    "SIGTERM while it starts": (TERM, lambda out: True, 2, ""),
}


@pytest.mark.slow
@pytest.mark.parametrize("what", sampled(ONCE, 2))
def test_a_run_that_is_told_to_stop_says_how_to_go_on_and_does(
    tmp_path: Path, want: Path, what: str
) -> None:
    number, moment, workers, last = ONCE[what]
    out = tmp_path / "ds.zarr"
    with running(out, workers) as process:
        wait(process, lambda: moment(out))
        send(process, number, group=workers == 2)
        said = check_end(process, out, {128 + number})
    assert said.startswith(last or ("Stopped: ", "Error: stopped"))
    if last:
        assert said.endswith("; run the same command again to continue.")
    assert not list(tmp_path.glob("*.lock")), "it let the store go"
    check_completion(out, want)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("moment", "gap_s"), [(is_creating, 0.05), (has_a_block, 0.003)], ids=["creating", "a block"]
)
def test_a_second_ctrl_c_stops_at_once_and_the_store_can_be_gone_on_with(
    tmp_path: Path, want: Path, moment: Callable[[Path], bool], gap_s: float
) -> None:
    out = tmp_path / "ds.zarr"
    with running(out, workers=2) as process:
        wait(process, lambda: moment(out))
        for _ in range(2):
            send(process, INT, group=True)
            time.sleep(gap_s)
        check_end(process, out, {130})
    check_completion(out, want)


@pytest.mark.soak
@pytest.mark.slow
def test_a_run_that_is_stopped_at_random_instants_ends_in_the_same_bytes(
    tmp_path: Path, want: Path
) -> None:
    chance, out, stopped = random.Random(5), tmp_path / "ds.zarr", 0
    out.mkdir()  # an empty directory is created in, piece by piece
    for _ in range(scaled(2, 5)):
        signals = chance.choice([[INT], [TERM], [INT, INT], [TERM, TERM], [TERM, INT], [INT, TERM]])
        with running(out, workers=chance.choice([1, 2])) as process:
            time.sleep(chance.uniform(0.0, 1.5))
            for number in signals:
                send(process, number, group=chance.random() < 0.5)
                time.sleep(chance.choice([0.0, 0.01, 0.1]))
            check_end(process, out, {0, 130, 143, -INT, -TERM})
        stopped += process.returncode != 0  # a signal at Python's very end kills: a shell's 130
    assert stopped > 0
    check_completion(out, want, complete_by_command)


def test_a_reader_that_waits_for_ever_does_not_hold_up_a_stopped_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(run_progress, "READ_S", 0.05)
    monkeypatch.setattr(
        run_progress.Dataset, "__init__", lambda self, path: threading.Event().wait()
    )
    said = run_progress.stopped_text(Path("ds.zarr"))
    assert said == "Stopped: committed episodes stay; run the same command again to continue."


CHILD = """
import atexit, os, signal, sys, time
from grasp_factory.errors import Terminated
from grasp_factory.cli.signal_handling import leave, signals_as_exceptions
def tell(number): os.kill(os.getpid(), number)
def wait():  # one long sleep would hold up a signal that comes just before it begins
    for _ in range(6000): time.sleep(0.01)
"""


def child(code: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", CHILD + code], capture_output=True, text=True, check=False, cwd=cwd
    )


class TestASignal:
    @pytest.mark.parametrize(
        ("number", "error"), [("SIGINT", "KeyboardInterrupt"), ("SIGTERM", "Terminated")]
    )
    def test_waits_until_a_module_is_whole(self, tmp_path: Path, number: str, error: str) -> None:
        (tmp_path / "half.py").write_text(
            "import os, signal, time\n"
            f"os.kill(os.getpid(), signal.{number})\n"
            f"time.sleep({3 * RETRY_S})\n"
            "whole = True\n"
        )
        done = child(
            "try:\n"
            "    with signals_as_exceptions():\n"
            "        try:\n"
            "            import half\n"
            "            wait()\n"
            "        finally:\n"
            "            print(half.whole)\n"
            "except KeyboardInterrupt as error:\n"
            "    print(type(error).__name__)\n",
            cwd=tmp_path,
        )
        assert (done.stdout.split(), done.stderr) == (["True", error], "")

    def test_that_a_finaliser_swallowed_comes_again(self) -> None:
        done = child(
            "class Last:\n"
            "    def __del__(self):\n"
            "        tell(signal.SIGINT)\n"
            "        time.sleep(0)\n"
            "try:\n"
            "    with signals_as_exceptions():\n"
            "        Last()\n"
            "        wait()\n"
            "except KeyboardInterrupt:\n"
            "    print('stopped')\n"
        )
        assert (done.stdout, done.stderr) == ("stopped\n", "")

    @pytest.mark.parametrize(
        "then", ["", "tell(signal.SIGTERM)"], ids=["alone", "after SIGTERM, which changes nothing"]
    )
    def test_that_is_the_second_ctrl_c_ends_it_at_once(self, then: str) -> None:
        done = child(
            "with signals_as_exceptions():\n"
            "    try:\n"
            "        tell(signal.SIGINT)\n"
            "        wait()\n"
            "    finally:\n"
            f"        {then or 'pass'}\n"
            "        print('tidying', flush=True)\n"
            "        tell(signal.SIGINT)\n"
            "        wait()\n"
        )
        assert (done.returncode, done.stdout, done.stderr) == (130, "tidying\n", "")

    @pytest.mark.parametrize("first", ["pass", "tell(signal.SIGTERM)"], ids=["done", "stopped"])
    def test_during_pythons_own_end_leaves_no_traceback(self, first: str) -> None:
        done = child(
            "atexit.register(tell, signal.SIGINT)\n"
            "try:\n"
            "    with signals_as_exceptions():\n"
            f"        {first}\n"
            "except KeyboardInterrupt:\n"
            "    leave(143)\n"
        )
        want = 130 if first == "pass" else 143
        assert (done.returncode, done.stdout, done.stderr) == (want, "", "")

    def test_that_the_shell_ignores_in_the_background_stays_ignored(self) -> None:
        done = child(
            "signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
            "with signals_as_exceptions():\n"
            "    tell(signal.SIGINT)\n"
            "    try:\n"
            "        tell(signal.SIGTERM)\n"
            "    except Terminated:\n"
            "        tell(signal.SIGINT)\n"
            "        print('in order')\n"
        )
        assert (done.returncode, done.stdout, done.stderr) == (0, "in order\n", "")
