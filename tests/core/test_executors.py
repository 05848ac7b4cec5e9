"""The pool of processes: no death, error or interrupt leaves a trace."""

from __future__ import annotations

import functools
import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from multiprocessing import get_context, spawn
from pathlib import Path
from typing import Any

import pytest
from support import fake_blocks as blocks
from support.places import TESTS

from grasp_factory.core import disk_usage
from grasp_factory.core.executors import (
    InlineExecutor,
    ProcessExecutor,
    SharingExecutor,
    early_workers,
    import_process,
    make_executor,
    process_start,
)
from grasp_factory.core.executors.limited import LimitedExecutor, ProcessLimits
from grasp_factory.core.executors.team import MOST_UNSTARTED
from grasp_factory.core.limits import CHUNK, MEMORY, Limit
from grasp_factory.errors import LimitError, RecipeError, WorkerError

ROOT = TESTS.parent
pytestmark = pytest.mark.timeout(60)


def ignore(_message: Any) -> None:
    pass


def is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    return state != "Z"


def wait_until_gone(pids: list[int]) -> bool:
    deadline = time.monotonic() + 10.0
    while time.monotonic() < deadline:
        if not any(is_running(pid) for pid in pids):
            return True
        time.sleep(0.05)
    return False


def test_the_time_of_an_import_follows_what_is_on_the_disk(tmp_path: Path) -> None:
    given: list[int] = []

    class Noting(InlineExecutor):
        def __init__(self, limits: ProcessLimits) -> None:
            given.append(limits.cpu.usual)

    with (tmp_path / "holes").open("wb") as file:
        file.truncate(2**40)
    (tmp_path / "link").symlink_to(__file__)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(import_process, "reading_executor", Noting)
        for size in (0, 5_000_000, 2_000_000_000):
            patch.setattr(disk_usage, "bytes_on_disk", lambda _, size=size: size // 4)
            import_process.in_import_process(blocks.process_id, 0, tmp_path)
    assert given == [5, 5 + 37, 3600]


def test_one_worker_needs_no_pool() -> None:
    assert isinstance(make_executor(1), InlineExecutor)
    assert make_executor(3) == ProcessExecutor(3)


def test_the_calling_process_works_too_and_starts_no_worker_without_need() -> None:
    assert SharingExecutor(2).run(blocks.process_id, [0], ignore) == [os.getpid()]
    assert SharingExecutor(1).run(blocks.process_id, range(3), ignore) == [os.getpid()] * 3


def test_workers_get_jobs_while_the_calling_process_does_its_own() -> None:
    blocks.HEARD.clear()
    pids = SharingExecutor(2).run(blocks.first_waits_for_others, range(4), blocks.HEARD.append)
    (worker,) = set(pids[1:])
    assert pids[0] == os.getpid() != worker
    assert wait_until_gone([worker])


def test_early_workers_do_the_jobs_and_end_with_their_block() -> None:
    blocks.HEARD.clear()
    with early_workers(1, ["support.fake_blocks", "zipapp"]) as ready:
        (early,) = (worker.process.pid for worker in ready)
        executor = SharingExecutor(2, ready)
        pids = executor.run(blocks.first_waits_for_others, range(4), blocks.HEARD.append)
    assert pids == [os.getpid(), early, early, early]
    with pytest.raises(RecipeError), early_workers(2, ["zipapp"]) as ready:
        pids = [worker.process.pid for worker in ready]
        raise RecipeError
    assert wait_until_gone([early, *pids])


def test_an_early_worker_that_died_is_replaced() -> None:
    blocks.HEARD.clear()
    with early_workers(1, ["no_such_module"]) as ready:
        ready[0].process.join()
        executor = SharingExecutor(2, ready)
        pids = executor.run(blocks.first_waits_for_others, range(4), blocks.HEARD.append)
    assert pids[0] == os.getpid()
    assert ready[0].process.pid not in pids


def test_workers_are_other_processes_and_no_more_than_asked() -> None:
    pids = ProcessExecutor(2).run(blocks.process_id, range(6), ignore)
    assert os.getpid() not in pids
    assert len(set(pids)) <= 2
    assert wait_until_gone(pids)


def test_a_worker_is_replaced_after_its_number_of_blocks() -> None:
    pids = ProcessExecutor(1, jobs_per_process=2).run(blocks.process_id, range(5), ignore)
    assert pids[0] == pids[1] != pids[2] == pids[3] != pids[4]


def test_recycling_with_many_more_blocks_than_workers_does_not_hang() -> None:
    results = ProcessExecutor(2, jobs_per_process=1).run(blocks.square, range(7), ignore)
    assert results == [b * b for b in range(7)]


def test_thousands_of_messages_fill_no_pipe_for_ever() -> None:
    seen: list[Any] = []
    assert ProcessExecutor(2).run(blocks.chatty, [0, 1], seen.append) == [0, 1]
    assert len(seen) == 10_000


def test_workers_use_one_thread_and_the_parent_keeps_its_environment() -> None:
    before = dict(os.environ)
    assert ProcessExecutor(1).run(blocks.environment, [0], ignore) == [("1", "1")]
    assert dict(os.environ) == before


def test_what_a_worker_prints_from_c_stays_out_of_stdout(capfd: pytest.CaptureFixture[str]) -> None:
    ProcessExecutor(1).run(blocks.noisy, [0], ignore)
    out, err = capfd.readouterr()
    assert out == ""
    assert "a warning of the physics library" in err


def test_an_error_carries_the_workers_traceback() -> None:
    with pytest.raises(RecipeError) as caught:
        ProcessExecutor(1).run(blocks.user_error, [3], ignore)
    assert "in user_error" in "".join(caught.value.__notes__)


def test_an_error_that_cannot_travel_is_not_swallowed() -> None:
    with pytest.raises(RuntimeError, match="Unpicklable: lost"):
        ProcessExecutor(1).run(blocks.strange_error, [0], ignore)


def test_a_worker_that_exits_is_an_error_that_names_job_and_exit_code() -> None:
    with pytest.raises(WorkerError, match=r"lost in 4 \(exit code 7\)"):
        ProcessExecutor(1).run(blocks.exit_early, [4], ignore)


UNGUARDED = """
from support import fake_blocks
from grasp_factory.core.executors import ProcessExecutor
ProcessExecutor(2).run(fake_blocks.square, [0, 1], print)
"""


@pytest.mark.parametrize("failures", [2, 100])
def test_a_worker_that_the_system_cannot_start_is_started_again(
    monkeypatch: pytest.MonkeyPatch, failures: int
) -> None:
    real = spawn.get_executable()
    names = itertools.chain(itertools.repeat(b"/nowhere/python", failures), itertools.repeat(real))
    monkeypatch.setattr(spawn, "get_executable", lambda: next(names))
    if failures > MOST_UNSTARTED:
        with pytest.raises(WorkerError, match="exit code 255"):
            ProcessExecutor(2).run(blocks.square, [3], ignore)
    else:
        assert ProcessExecutor(2).run(blocks.square, [3, 4], ignore) == [9, 16]


def test_a_script_without_its_main_guard_is_told_of_it(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(UNGUARDED)
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, check=False,
        env=os.environ | {"PYTHONPATH": f"{ROOT}:{TESTS}"},
    )  # fmt: skip
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert "(exit code 1) before it began: " in last
    assert "ConnectionResetError" not in done.stderr
    assert 'under `if __name__ == "__main__":`' in last


def test_generate_without_a_main_guard_says_so_in_few_lines(tmp_path: Path) -> None:
    script = tmp_path / "make.py"
    script.write_text(
        "from grasp_factory import FactoryConfig, generate\n"
        "generate(FactoryConfig(resolution=(32, 24)), 2, 's.zarr')\n"
    )
    command = [sys.executable, str(script)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "the script starts workers again: put the call under `if __name__" in done.stderr
    assert "runpy" not in done.stderr
    assert "ConnectionResetError" not in done.stderr


SQUARES = """
from support import fake_blocks
from grasp_factory.core.executors import ProcessExecutor
if __name__ == "__main__":
    assert ProcessExecutor(2).run(fake_blocks.square, [3, 4], lambda _: None) == [9, 16]
"""


@pytest.mark.parametrize("name", ["-", "/dev/stdin"])
def test_a_script_from_a_pipe_can_start_workers(name: str) -> None:
    done = subprocess.run(
        [sys.executable, name], input=SQUARES, capture_output=True, text=True, check=False,
        env=os.environ | {"PYTHONPATH": f"{ROOT}:{TESTS}"},
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_files_in_the_current_folder_are_not_taken_for_modules_of_python(tmp_path: Path) -> None:
    folder, scripts = tmp_path / "here", tmp_path / "scripts"
    for each in (folder, scripts):
        each.mkdir()
    for name in ("signal", "os", "pickle", "numpy"):
        (folder / f"{name}.py").write_text("raise SystemExit('a file of the user')")
    (scripts / "squares.py").write_text(SQUARES)
    done = subprocess.run(
        [sys.executable, str(scripts / "squares.py")], cwd=folder, capture_output=True, text=True,
        check=False, env=os.environ | {"PYTHONPATH": f"{ROOT}:{TESTS}"},
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_process_that_can_start_no_workers_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with get_context("spawn").Pool(1) as pool, pytest.raises(WorkerError, match="use workers=1"):
        pool.apply(blocks.squares_in_workers)
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with pytest.raises(WorkerError, match="the current folder was deleted"):
        blocks.squares_in_workers()


def test_a_killed_worker_is_an_error_that_names_job_and_signal() -> None:
    seen: list[int] = []
    with pytest.raises(WorkerError, match=r"lost in 2 \(SIGKILL\)"):
        ProcessExecutor(2).run(blocks.dies_in_block_two, range(50), seen.append)
    assert 49 not in seen


def test_a_lost_worker_is_replaced_and_its_job_done_otherwise() -> None:
    asked: list[tuple[int, str]] = []

    def recover(job: int, why: str) -> int:
        asked.append((job, why))
        return job + 100

    results = ProcessExecutor(2).run(blocks.dies_in_block_two, range(5), ignore, recover)
    assert results == [0, 1, 102, 3, 4]
    assert asked == [(2, "SIGKILL")]


def test_a_worker_that_is_silent_too_long_is_lost_even_when_it_is_stopped() -> None:
    why: list[str] = []

    def recover(job: int, cause: str) -> int:
        why.append(cause)
        return 0

    def silence(message: Any) -> float:
        return 2.0 if message == "stops" else 60.0

    assert ProcessExecutor(2).run(blocks.stops, [0, 1], ignore, recover, silence) == [0, 0]
    assert why == ["silent for more than 2 s"]


def test_an_exception_of_the_caller_ends_the_workers() -> None:
    pids: list[int] = []

    def stop(pid: int) -> None:
        pids.append(pid)
        if len(pids) == 2:
            raise KeyboardInterrupt

    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        ProcessExecutor(2).run(blocks.sleeps, range(4), stop)
    assert time.monotonic() - start < 20.0
    assert wait_until_gone(pids)


def test_a_check_that_raises_ends_workers_that_say_nothing() -> None:
    pids: list[int] = []

    def check() -> None:
        if pids:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ProcessExecutor(1, check=check).run(blocks.sleeps, range(1), pids.append)
    assert wait_until_gone(pids)


def test_a_worker_does_not_mind_the_ctrl_c_that_is_for_the_coordinator() -> None:
    def interrupt(pid: int) -> None:
        os.kill(pid, signal.SIGINT)

    assert ProcessExecutor(1).run(blocks.naps, [0, 1], interrupt) == [0, 1]


def test_ctrl_c_that_another_thread_receives_waits_until_a_worker_has_started() -> None:
    done, begin, before = [], threading.Event(), signal.getsignal(signal.SIGINT)
    receive = lambda: begin.wait() and signal.raise_signal(signal.SIGINT)  # noqa: E731
    thread = threading.Thread(target=receive)
    thread.start()  # now: later it would block the signal, as a worker does
    with pytest.raises(KeyboardInterrupt), process_start.no_interrupt():
        begin.set()
        thread.join()
        done.append("started")
    assert done == ["started"]
    assert signal.getsignal(signal.SIGINT) is before


def test_a_job_that_cannot_be_interrupted_ends_soon_after_its_limit_of_time() -> None:
    cpu = Limit("seconds", 1, "the CPU time of a test", is_count=True)
    limits = ProcessLimits(what="the test", memory=MEMORY, cpu=cpu, file=CHUNK)
    with pytest.raises(LimitError, match=r"the test takes more than 1 s; .*--limit seconds=N"):
        LimitedExecutor(1, limits).run(blocks.queries, [0], lambda message: None)


def test_threads_that_start_workers_leave_the_environment_as_it_was() -> None:
    has_it, leave = threading.Event(), threading.Event()

    def start_another() -> None:
        with process_start.environment(process_start.OF_A_WORKER):
            has_it.set()
            leave.wait()

    before, second = dict(os.environ), threading.Thread(target=start_another)
    with process_start.environment(process_start.OF_A_WORKER):
        second.start()
        has_it.wait(0.2)  # where both may have it, the second's ends last
    leave.set()
    second.join()
    assert dict(os.environ) == before


def test_a_worker_that_is_stopped_tidies_up_after_itself(tmp_path: Path) -> None:
    def stop(_pid: int) -> None:
        assert (tmp_path / "scratch").exists()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ProcessExecutor(1).run(functools.partial(blocks.tidies, folder=str(tmp_path)), [0], stop)
    assert not (tmp_path / "scratch").exists()


SCRIPT = """
from grasp_factory.core.executors import ProcessExecutor
from support import fake_blocks as blocks

if __name__ == "__main__":
    ProcessExecutor(2).run(blocks.sleeps, range(4), lambda pid: print(pid, flush=True))
"""


@pytest.fixture
def coordinator(tmp_path: Path) -> Any:
    """A script whose two workers sleep; it leads its own process group, as in a terminal."""
    script = tmp_path / "coordinate.py"
    script.write_text(SCRIPT)
    process = subprocess.Popen(
        [sys.executable, str(script)],
        env=os.environ | {"PYTHONPATH": f"{ROOT}:{TESTS}"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    yield process
    process.kill()
    process.communicate()


def test_ctrl_c_reaches_the_whole_group_and_only_the_coordinator_speaks(coordinator: Any) -> None:
    pids = [int(coordinator.stdout.readline()) for _ in range(2)]
    for pid in pids:
        os.kill(pid, signal.SIGINT)
    time.sleep(0.3)
    assert all(is_running(pid) for pid in pids)
    os.killpg(coordinator.pid, signal.SIGINT)
    _, err = coordinator.communicate(timeout=20)
    assert err.count("Traceback") == 1
    assert err.rstrip().endswith("KeyboardInterrupt")
    assert wait_until_gone(pids)


def test_workers_die_with_a_coordinator_that_is_killed(coordinator: Any) -> None:
    pids = [int(coordinator.stdout.readline()) for _ in range(2)]
    coordinator.kill()
    assert wait_until_gone(pids)
