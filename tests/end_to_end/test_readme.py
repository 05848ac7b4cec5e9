"""All blocks of the README run in their order, in a clone with an environment of its own."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest
from support.page_blocks import script_of
from support.places import REPOSITORY

MOST_LINES = 150


def text() -> str:
    return (REPOSITORY / "README.md").read_text(encoding="utf-8")


def test_it_is_short_and_has_a_picture_and_an_animation() -> None:
    assert len(text().splitlines()) <= MOST_LINES
    pictures = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", text())
    assert sorted(Path(picture).suffix for picture in pictures) == [".gif", ".png"]


@pytest.mark.soak
def test_every_block_runs_as_it_stands(tmp_path: Path) -> None:
    clone = tmp_path / "clone"
    subprocess.run(["git", "clone", "--quiet", REPOSITORY, clone], check=True)
    script = script_of(REPOSITORY / "README.md")
    env = {name: value for name, value in os.environ.items() if "PYTHON" not in name}
    done = subprocess.run(
        ["bash"], input=script, cwd=clone, env=env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]
    for made in ("grasps.zarr", "sheet.png", "mine.zarr"):
        assert (clone / made).exists(), made
    assert "success (2, 480, 640, 3)" in done.stdout
