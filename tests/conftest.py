"""One hypothesis profile for all, and the command, run in this process."""

from __future__ import annotations

import signal
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from support.scale import scaled

from grasp_factory.__main__ import main
from grasp_factory.core.cache import VARIABLE
from grasp_factory.core.executors import InlineExecutor, import_process
from grasp_factory.curation import isolation

# The same examples in every run, and no clock.
settings.register_profile(
    "fixed", derandomize=True, deadline=None, database=None, max_examples=scaled(40, 100)
)
settings.load_profile("fixed")

# A shell starts a background command with Ctrl-C ignored, and its children inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that have most slow tests, so that none of them is the last to run."""
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    items.sort(key=lambda item: -slow[item.path])


class _Here(InlineExecutor):
    """Runs a task as ``isolation.isolated`` does, in this process and without limits."""

    def run(self, task: Any, *args: Any) -> Any:  # type: ignore[override]
        """See ``Executor.run``."""
        try:
            return super().run(task, *args)
        finally:
            if maker := getattr(task, "__dict__", {}).get("_maker"):
                maker.close()


@pytest.fixture(scope="session", autouse=True)
def cache_of_tests(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Leave the cache of the person alone who runs the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(VARIABLE, str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def isolated() -> None:
    """Simulate recipes of stores, and import, in other processes, as commands do."""


@pytest.fixture(autouse=True)
def recipes_here(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Simulate recipes of stores, and import, in this process: it is faster to start."""
    if "isolated" not in request.fixturenames:
        monkeypatch.setattr(isolation, "isolated", lambda *how, **more: _Here())
        monkeypatch.setattr(import_process, "reading_executor", lambda limits: InlineExecutor())


@pytest.fixture
def run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """Run a command in this process; return exit code, stdout and stderr."""

    def run(*args: object) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["grasp-factory", *map(str, args)])
        with pytest.raises(SystemExit) as left:
            main()
        return int(left.value.code or 0), *capsys.readouterr()

    return run


@pytest.fixture
def complaint(
    run: Callable[..., tuple[int, str, str]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Callable[..., tuple[int, str]]:
    """Run a command in an empty folder; return exit code and stderr."""
    monkeypatch.chdir(tmp_path)

    def complain(*args: object) -> tuple[int, str]:
        code, _, said = run(*args)
        return code, said

    return complain
