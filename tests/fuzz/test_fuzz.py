"""Parsers of what a stranger may have made: valid inputs are parsed, others are refused."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from fuzz import bags, objects, page, sessions, stores
from fuzz.target import Target
from support.places import REPOSITORY, TESTS
from support.scale import IS_SOAK, scaled

pytestmark = pytest.mark.slow

MODULES = {
    "stores": stores.TARGETS,
    "objects": objects.TARGETS,
    "page": page.TARGETS,
    "bags": bags.TARGETS,
    "sessions": sessions.TARGETS,
}
TARGETS = {name: target for targets in MODULES.values() for name, target in targets.items()}
RUNS = {"stores": 15, "objects": 300, "page": 150, "bags": 5, "sessions": 50}
"""Inputs for each target in a normal run; the soak takes a hundred times as many."""


@pytest.mark.parametrize("name", TARGETS)
def test_an_example_is_parsed(name: str) -> None:
    for example in TARGETS[name].examples():
        TARGETS[name].parse(example)


def test_another_exception_than_a_refusal_is_a_fault() -> None:
    with pytest.raises(IndexError):
        Target(lambda data: data[5], list).run(b"ab")


def python(*arguments: object) -> subprocess.CompletedProcess[str]:
    paths = f"{REPOSITORY}{os.pathsep}{TESTS}"
    return subprocess.run(
        [sys.executable, "-m", *map(str, arguments)],
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("module", MODULES)
def test_no_input_of_a_fuzzer_makes_a_parser_fail(module: str, tmp_path: Path) -> None:
    pytest.importorskip("atheris", reason="Atheris has no wheel for this machine")
    runs = RUNS[module] * scaled(1, 100)
    done = python("fuzz", module, tmp_path, "-seed=1", f"-runs={runs}")
    logs = "\n".join(log.read_text(errors="replace")[-3000:] for log in tmp_path.glob("*.log"))
    assert done.returncode == 0, done.stdout + done.stderr + logs
    done_runs = [int(number) for number in re.findall(r"(\d+) runs", done.stdout)]
    assert len(done_runs) == len(MODULES[module])
    assert min(done_runs) >= runs  # it runs a slow input once more


@pytest.mark.soak
@pytest.mark.skipif(not IS_SOAK, reason="many passes over the inputs of a fuzzer")
@pytest.mark.parametrize("module", MODULES)
def test_parsing_again_and_again_takes_no_more_memory(module: str, tmp_path: Path) -> None:
    done = python("fuzz.replay", module, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
