"""Disks that fail: a clear error, nothing lost, and the same command goes on to the same bytes."""

from __future__ import annotations

import ctypes
import dataclasses
import errno
import json
import os
import resource
import subprocess
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import pytest
from support.fake_episodes import make_episode, small_config
from support.faulty_disk import FaultyDisk
from support.helpers import assert_same_tree, tree
from support.scale import sampled, soak_only

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.os_errors import HOW_TO_CONTINUE
from grasp_factory.errors import GraspFactoryWarning, RecipeError, StaleLockWarning, StoreError
from grasp_factory.factory import block_maker
from grasp_factory.factory.block_job import BlockJob
from grasp_factory.factory.block_maker import BlockMaker
from grasp_factory.factory.generate import generate
from grasp_factory.factory.run_log import RunLog
from grasp_factory.factory.run_request import Request
from grasp_factory.writers.zarr import segment_packing
from grasp_factory.writers.zarr.lock import StoreLock

pytestmark = pytest.mark.slow

CONFIG = small_config(block_size=2)
N = 4
ERRORS = (errno.ENOSPC, errno.EACCES, errno.EROFS, errno.EIO, errno.EDQUOT)


def pretend(world: Any, spec: Any) -> Any:
    """Return an episode that follows from its recipe, without physics."""
    made, target = make_episode(CONFIG, spec.index), spec.objects[0]
    more = {"policy": spec.policy, "object_set": target.object_set, "split": target.split}
    return dataclasses.replace(made, spec=spec, columns=dict(made.columns) | more)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(block_maker, "run_episode", pretend)
    monkeypatch.setattr(segment_packing, "SEGMENT_BLOCKS", 1)  # so that packing has its part


def make(out: Path, n: int = N) -> None:
    generate(CONFIG, n, out, workers=1)


STAGES = {
    "the lock": lambda done: done == "open .ds.zarr.grasp-factory.lock",
    "the diary": lambda done: done == "write ds.zarr.runs.jsonl",
    "the directory aside": lambda done: done == "mkdir .ds.zarr.creating",
    "an array's metadata": lambda done: done.startswith("write .ds.zarr.creating/streams"),
    "the sync of a creation": lambda done: done.startswith("fsync .ds.zarr.creating"),
    "the publication": lambda done: done == "replace .ds.zarr.creating",
    "a block's data": lambda done: done.startswith("write ds.zarr/cameras/front/rgb/1"),
    "a block's sync": lambda done: done.startswith("fsync ds.zarr/streams/phase/1"),
    "a rename": lambda done: done.startswith("replace ds.zarr/imu/timestamp/1."),
    "the commit marker": lambda done: done.startswith("replace ds.zarr/episodes/status/1."),
    "a claim": lambda done: done == "open ds.zarr/episodes/status/1.claim-0.partial",
    "the marker's sync": lambda done: done.startswith("fsync ds.zarr/episodes/status/1."),
    "a segment": lambda done: done.startswith("write ds.zarr/packed/1-1.npz"),
    "a segment's sync": lambda done: done.startswith("fsync ds.zarr/packed/1-1.npz"),
}


@pytest.fixture(scope="module")
def want(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the store of a run without faults."""
    out = tmp_path_factory.mktemp("want") / "ds.zarr"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(block_maker, "run_episode", pretend)
        patch.setattr(segment_packing, "SEGMENT_BLOCKS", 1)
        make(out)
    return out


@pytest.mark.usefixtures("quick")
class TestAFault:
    @pytest.mark.parametrize("stays", [*soak_only(False), True])
    @pytest.mark.parametrize("stage", sampled(STAGES, 5))
    def test_at_any_stage_is_one_error_and_the_run_is_gone_on_with(
        self, tmp_path: Path, want: Path, stage: str, stays: bool
    ) -> None:
        error = ERRORS[list(STAGES).index(stage) % len(ERRORS)]
        out = tmp_path / "ds.zarr"
        with FaultyDisk(tmp_path, STAGES[stage], error, stays=stays).installed() as disk:
            said = outcome(out)
        assert disk.has_failed
        if said:
            assert "\n" not in said
            assert str(tmp_path) in said
            assert os.strerror(error) in said
            assert said.endswith(HOW_TO_CONTINUE)
        else:
            # A diary without its line costs no episode.
            assert (stage, stays) == ("the diary", False)
        committed = markers(out)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StaleLockWarning)
            make(out)
        assert committed.items() <= markers(out).items()
        assert_same_tree(want, out)
        left = sorted(path.name for path in tmp_path.iterdir())
        assert left == ["ds.zarr", "ds.zarr.runs.jsonl"]

    def test_of_growing_leaves_the_rows_that_were_there(self, tmp_path: Path) -> None:
        make(tmp_path / "a.zarr", n=2)
        make(tmp_path / "b.zarr", n=2)
        before = markers(tmp_path / "a.zarr")
        faulty = FaultyDisk(tmp_path, is_growing, errno.ENOSPC, stays=True)
        with faulty.installed():
            assert outcome(tmp_path / "a.zarr")
        assert faulty.has_failed
        assert markers(tmp_path / "a.zarr") == before
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StaleLockWarning)
            make(tmp_path / "a.zarr")
        make(tmp_path / "b.zarr")
        assert_same_tree(tmp_path / "a.zarr", tmp_path / "b.zarr")


def is_growing(done: str) -> bool:
    return done.startswith("replace a.zarr/streams/phase/zarr.json")


def markers(out: Path) -> dict[str, bytes]:
    """Return the commit markers of a store's blocks."""
    return {name: data for name, data in tree(out / "episodes/status").items() if name.isdecimal()}


def outcome(out: Path) -> str:
    """Return what a run on a faulty disk ended with; empty if it was done."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GraspFactoryWarning)  # a diary without its line
        try:
            make(out)
        except StoreError as error:
            return str(error)
    return ""


@pytest.mark.parametrize("number", [errno.EMFILE, errno.EACCES, errno.ENOSPC, errno.ENOMEM])
@pytest.mark.parametrize("wrapped", [False, True], ids=["itself", "as a recipe's error"])
def test_an_episode_is_not_quarantined_for_what_the_machine_did(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, wrapped: bool
) -> None:
    make_empty(tmp_path / "ds.zarr", monkeypatch)

    def fail(*_: Any) -> Any:
        try:
            raise OSError(number, os.strerror(number))
        except OSError as error:
            if not wrapped:
                raise
            raise RecipeError(f"robot.urdf cannot be loaded: {error}") from None

    monkeypatch.setattr(block_maker, "run_episode", fail)
    with pytest.raises(StoreError) as caught:
        BlockMaker(CONFIG, tmp_path / "ds.zarr")(BlockJob(block=0), lambda message: None)
    want = f"episode 0 cannot be made: {os.strerror(number)}; {HOW_TO_CONTINUE}"
    assert str(caught.value) == want
    assert not (tmp_path / "ds.zarr/episodes/status/0").exists()


def make_empty(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make a store without episodes."""

    class Stop(Exception):
        pass

    def stop(plan: Any) -> None:
        raise Stop

    with pytest.raises(Stop):
        generate(CONFIG, N, out, workers=1, on_start=stop)


def test_a_line_of_the_diary_that_was_cut_short_takes_no_other_along(tmp_path: Path) -> None:
    store = tmp_path / "ds.zarr"
    request = Request(config=CONFIG, n=1, out=store)
    diary = tmp_path / "ds.zarr.runs.jsonl"
    diary.write_text('{"started": "20')
    for _ in range(2):
        with RunLog(store, request) as log:
            log.begin()
    cut, *lines = diary.read_text().splitlines()
    assert cut == '{"started": "20'
    assert [json.loads(line)["ended"] for line in lines] == ["done", "done"]


def test_a_lock_that_cannot_be_removed_tells_of_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def forbid(*_: Any, **__: Any) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr(os, "unlink", forbid)
        with StoreLock(tmp_path / "ds.zarr") as lock:
            pass
    assert lock.file.exists()
    with StoreLock(tmp_path / "ds.zarr"):  # without a StaleLockWarning
        pass
    assert not lock.file.exists()


# --- real disks ---------------------------------------------------------------------------------

COMMAND = [
    *(sys.executable, "-m", "grasp_factory", "generate", "--n", "4", "--seed", "3", "--quiet"),
    *("--resolution", "320x240", "--set", "block_size=2", "--workers", "1", "--out"),
]
REAL = FactoryConfig(seed=3, resolution=(320, 240), block_size=2)
FULL = """
mount -t tmpfs -o size={size} none {place} || exit 99
cd {place}
"$@" m.zarr; echo "code $?"
{mend}
"$@" m.zarr; echo "code $?"
cp -a . {result}
"""


def may_mount() -> bool:
    words = ["unshare", "-rm", "sh", "-c", "mount -t tmpfs none /mnt"]
    try:
        return subprocess.run(words, capture_output=True, check=False, timeout=30).returncode == 0
    except OSError:
        return False


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("clean") / "m.zarr"
    complete(path)
    return path


def complete(out: Path) -> None:
    """Do what the command does, in this process."""
    generate(REAL, 4, out, workers=1)


def check_line(text: str, reason: str) -> None:
    """Check that stderr is one error, after warnings at most."""
    *before, last = text.splitlines()
    assert last.startswith("Error: ")
    assert f": {reason}; {HOW_TO_CONTINUE}" in last
    assert all(line.startswith("Warning: ") for line in before)


@pytest.mark.skipif(not may_mount(), reason="unshare and mount are not permitted here")
@pytest.mark.parametrize("size", ["1200k", *soak_only("100k")], ids=["a block", "creating"])
def test_a_full_disk_is_gone_on_with_after_space_is_made(
    tmp_path: Path, clean: Path, size: str
) -> None:
    place, result = tmp_path / "disk", tmp_path / "result"
    place.mkdir()
    result.mkdir()
    script = FULL.format(
        size=size, place=place, result=result, mend=f"mount -o remount,size=64M {place}"
    )
    done = subprocess.run(
        ["unshare", "-rm", "sh", "-c", script, "sh", *COMMAND],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stdout.split("\n")[:2] == ["code 1", "code 0"], done.stderr
    check_line(done.stderr, "No space left on device")
    assert_same_tree(clean, result / "m.zarr")
    assert sorted(path.name for path in result.iterdir()) == ["m.zarr", "m.zarr.runs.jsonl"]


@pytest.mark.parametrize(
    "limit", [1 << 13, 1 << 16], ids=["the engine's files in memory", "images"]
)
def test_a_file_size_limit_is_gone_on_with_after_it_is_lifted(
    tmp_path: Path, clean: Path, limit: int
) -> None:
    largest = max(file.stat().st_size for file in clean.rglob("*") if file.is_file())
    assert largest > limit, "else nothing would fail"

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))

    out = tmp_path / "m.zarr"
    done = subprocess.run(
        [*COMMAND, str(out)], capture_output=True, text=True, check=False, preexec_fn=limited
    )
    assert done.returncode == 1
    check_line(done.stderr, "File too large")
    complete(out)
    assert_same_tree(clean, out)


LIBC = ctypes.CDLL(None)
PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH = 24, 1, 2


def bound_by_permissions() -> None:
    """Let permission bits bind the superuser, too. Runs in the child."""
    if os.geteuid() == 0:
        for capability in (CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH):
            if LIBC.prctl(PR_CAPBSET_DROP, capability, 0, 0, 0):
                os._exit(99)


def test_a_read_only_directory_is_refused_and_then_used(tmp_path: Path, clean: Path) -> None:
    place = tmp_path / "place"
    place.mkdir(mode=0o555)
    done = subprocess.run(
        [*COMMAND, str(place / "m.zarr")],
        capture_output=True, text=True, check=False, preexec_fn=bound_by_permissions,
    )  # fmt: skip
    assert done.returncode == 1
    check_line(done.stderr, "Permission denied")
    assert list(place.iterdir()) == []
    place.chmod(0o755)
    complete(place / "m.zarr")
    assert_same_tree(clean, place / "m.zarr")


@pytest.mark.soak
def test_permission_that_is_lost_meanwhile_is_given_back_and_the_run_goes_on(
    tmp_path: Path, clean: Path
) -> None:
    out = tmp_path / "m.zarr"
    process = subprocess.Popen(
        [*COMMAND, str(out)],
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=bound_by_permissions,  # noqa: PLW1509
    )
    deadline = time.monotonic() + 120.0
    while not (out / "zarr.json").exists():
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.005)
    folders = [out / "streams/phase", out / "episodes/status"]
    for folder in folders:
        folder.chmod(0o555)
    _, stderr = process.communicate(timeout=120)
    assert process.returncode == 1
    check_line(stderr, "Permission denied")
    before = markers(out)
    for folder in folders:
        folder.chmod(0o755)
    complete(out)
    assert before.items() <= markers(out).items()
    assert_same_tree(clean, out)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.zarr", "m.zarr.runs.jsonl"]


def test_a_folder_that_may_not_be_entered_is_one_line_for_who_reads(clean: Path) -> None:
    folder = clean / "cameras/front/rgb"
    folder.chmod(0)
    try:
        for command in (["info"], ["replay"]):
            done = subprocess.run(
                [sys.executable, "-m", "grasp_factory", *command, str(clean),
                 *(["0"] if command == ["replay"] else [])],
                capture_output=True, text=True, check=False, preexec_fn=bound_by_permissions,
            )  # fmt: skip
            assert done.returncode == 1
            assert done.stderr.startswith("Error: ")
            assert done.stderr.count("\n") == 1
            assert "Permission denied" in done.stderr
    finally:
        folder.chmod(0o755)
