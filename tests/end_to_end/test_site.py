"""The documentation as a site."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.mark.soak
def test_it_is_built_without_a_warning_and_has_commands_and_python(tmp_path: Path) -> None:
    site = tmp_path / "site"
    command = [REPOSITORY / "bin/docs", "--site-dir", site]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "capture-import" in (site / "reference/commands.html").read_text()
    assert "balanced" in (site / "reference/api.html").read_text()
    assert "grasp_factory/" not in "".join(
        line for line in (site / "index.html").read_text().splitlines() if "href" in line
    )
