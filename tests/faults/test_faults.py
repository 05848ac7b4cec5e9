"""The table of faults fits the package, and the runner tells what is caught from what is not."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest
from support.places import REPOSITORY, TESTS

from faults.fault import PACKAGE, Fault
from faults.running import Result, Verdict, Width, failing_anyway, try_fault
from faults.table import FAULTS

BY_NAME = {fault.name: fault for fault in FAULTS}
named = pytest.mark.parametrize("name", BY_NAME)


@named
def test_a_faults_text_occurs_once_and_leaves_python_behind(name: str) -> None:
    fault = BY_NAME[name]
    text = fault.text(REPOSITORY)
    changed = fault.changed(text)
    assert changed != text
    if fault.is_python:
        ast.parse(changed)


@named
def test_a_faults_tests_exist(name: str) -> None:
    assert BY_NAME[name].tests
    assert [path for path in BY_NAME[name].tests if not (TESTS / path).exists()] == []
    assert (TESTS / BY_NAME[name].room).is_dir()


def test_every_room_has_faults_of_different_names() -> None:
    rooms = {path.parent.name for path in (REPOSITORY / PACKAGE).glob("*/__init__.py")}
    assert rooms == {Path(fault.file).parts[0] for fault in FAULTS if "/" in fault.file}
    assert len(BY_NAME) == len(FAULTS) >= 64
    assert [name for name in BY_NAME if not re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)+", name)] == []


def test_a_text_that_occurs_twice_is_refused() -> None:
    fault = Fault("a-name", "core/a.py", "x", "y", ("core",))
    with pytest.raises(ValueError, match="its text occurs 2 times"):
        fault.changed("x + x")


@pytest.mark.slow
class TestRunner:
    @pytest.fixture
    def repository(self, tmp_path: Path) -> Path:
        """Return a repository with one function, and a test of half of what it does."""
        files = {
            f"{PACKAGE}/__init__.py": "",
            f"{PACKAGE}/core/__init__.py": "",
            f"{PACKAGE}/core/sums.py": "def add(a, b):\n    return a + b\n",
            "tests/core/test_sums.py": (
                f"from {PACKAGE}.core.sums import add\n\n"
                "def test_zero_is_neutral():\n    assert add(1, 0) == 1\n"
            ),
            "tests/core/test_more.py": (
                f"from {PACKAGE}.core.sums import add\n\n"
                "def test_one_is_added():\n    assert add(1, 1) == 2\n"
            ),
        }
        for name, text in files.items():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text(text)
        (tmp_path / "setup.cfg").write_text("[tool:pytest]\naddopts = --import-mode=importlib\n")
        return tmp_path

    def tried(self, repository: Path, new: str, widest: Width) -> Result:
        fault = Fault("a-name", "core/sums.py", "a + b", new, ("core/test_sums.py",))
        return try_fault(fault, repository, widest, "")

    def test_what_the_named_tests_miss_the_rooms_may_catch(self, repository: Path) -> None:
        missed = self.tried(repository, "a - b", Width.NAMED)
        assert (missed.verdict, missed.width, missed.test) == ("not caught", "named", "")
        caught = self.tried(repository, "a - b", Width.ROOM)
        assert (caught.verdict, caught.width) == (Verdict.CAUGHT, Width.ROOM)
        assert caught.test == "tests/core/test_more.py::test_one_is_added"
        assert "a + b" in (repository / PACKAGE / "core/sums.py").read_text()

    @pytest.mark.parametrize("new", ["a +", "a + b\n\n\nundefined"])
    def test_what_does_not_import_is_no_fair_fault(self, repository: Path, new: str) -> None:
        assert self.tried(repository, new, Width.NAMED).verdict == Verdict.BROKEN

    def test_a_test_that_fails_anyway_is_told(self, repository: Path) -> None:
        failing = "tests/core/test_failing.py::test_never"
        (repository / "tests/core/test_failing.py").write_text("def test_never():\n    assert 0\n")
        passing = "tests/core/test_more.py::test_one_is_added"
        assert failing_anyway([passing, failing], repository) == {failing}
