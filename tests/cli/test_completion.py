"""Shells complete commands, options and names, and are never shown an error."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.shell_completion import ShellComplete, get_completion_class
from support.places import REPOSITORY

from grasp_factory.cli.main import cli

VARIABLE = "_GRASP_FACTORY_COMPLETE"


def completed(*words: str) -> list[str]:
    """Return what completes the last of the words after ``grasp-factory``."""
    shell = ShellComplete(cli, {}, "grasp-factory", VARIABLE)
    return [item.value for item in shell.get_completions(list(words[:-1]), words[-1])]


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (("gen",), ["generate"]),
        (("generate", "--pol"), ["--policy"]),
        (("generate", "--physics", ""), ["default", "fast"]),
        (("generate", "--policy", "top"), ["top_down"]),
        (("generate", "--robot", "p"), ["panda"]),
        (("generate", "--objects", "c"), ["classic"]),
        (("capture", "ru"), ["run"]),
        (("export", "s.zarr", "out", "--to", "coc"), ["coco"]),
        (("query", "s.zarr", "--sort", "lift"), ["lift_height"]),
        (("no_such_command", "x"), []),
    ],
)
def test_what_was_begun_is_completed(words: tuple[str, ...], found: list[str]) -> None:
    assert completed(*words) == found


def test_what_is_no_name_may_be_a_file() -> None:
    shell = ShellComplete(cli, {}, "grasp-factory", VARIABLE)
    (item,) = shell.get_completions(["generate", "--policy"], "my_f")
    assert (item.type, item.value) == ("file", "my_f")


@pytest.mark.parametrize("name", ["bash", "zsh", "fish"])
def test_each_shell_that_the_guide_names_has_a_script(name: str) -> None:
    shell = get_completion_class(name)
    assert shell is not None
    script = shell(cli, {}, "grasp-factory", VARIABLE).source_template
    assert f"{name}_complete" in script
    guide = (REPOSITORY / "docs/guides/installing.md").read_text(encoding="utf-8")
    assert f"{VARIABLE}={name}_source grasp-factory >" in guide


@pytest.mark.slow
def test_bash_completes_a_command(tmp_path: Path) -> None:
    command = tmp_path / "grasp-factory"
    command.write_text(f'#!/bin/sh\nexec {sys.executable} -m grasp_factory "$@"\n')
    command.chmod(0o755)
    script = f"""
    eval "$({VARIABLE}=bash_source grasp-factory)"
    COMP_WORDS=(grasp-factory verif) COMP_CWORD=1
    _grasp_factory_completion grasp-factory
    echo "${{COMPREPLY[@]}}"
    """
    variables = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "PYTHONPATH": str(REPOSITORY)}
    done = subprocess.run(
        ["bash", "-c", script], env=os.environ | variables, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    assert (done.stdout, done.stderr) == ("verify\n", "")
