"""The Python code of every page runs as printed, in a folder with a small dataset grasps.zarr."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from support.places import DOCS, REPOSITORY
from support.plugin_files import forget_plugins
from support.scenes import cube_spec, take_images

from grasp_factory.apps.conformance.conformance_run import checks_of, results, row_named
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.factory.generate import generate
from grasp_factory.simulation.scene import build_scene, observe
from grasp_factory.simulation.world import World

N = 22
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def code_of(page: Path) -> str:
    return "\n".join(BLOCK.findall(page.read_text(encoding="utf-8")))


PAGES = {
    str(page.relative_to(REPOSITORY)): page
    for page in (*REPOSITORY.glob("*.md"), *sorted(DOCS.rglob("*.md")))
    if code_of(page)
}


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store with objects of all splits."""
    path = tmp_path_factory.mktemp("docs") / "grasps.zarr"
    generate(FactoryConfig.from_plain({"resolution": [96, 72], "block_size": 4}), N, path)
    return path


def two_epochs(printed: str) -> None:
    lines = [line.split() for line in printed.splitlines()]
    assert [line[0] for line in lines] == ["0", "1"]
    for _, loss, right in lines:
        assert 0.0 < float(loss) < 10.0
        assert 0.0 <= float(right) <= 1.0


def signals_of_an_episode(printed: str) -> None:
    found = re.fullmatch(
        r"\((\d+), 2, 24, 10\) \((\d+), 6\) \((\d+), 3\) \((\d+), 7\) ([\d.]+)\n", printed
    )
    assert found
    records, loads, noisy, poses = map(int, found.groups()[:4])
    assert records == loads > 0
    assert noisy == poses > 0
    assert float(found[5]) > 0.9


CHECKS: Mapping[str, Callable[[str], None]] = {
    "docs/guides/torch.md": two_epochs,
    "docs/reference/signals.md": signals_of_an_episode,
}
"""What the output of some pages must look like."""


@pytest.mark.slow
@pytest.mark.parametrize("name", PAGES)
def test_the_code_of_a_page_runs_as_printed(name: str, path: Path, tmp_path: Path) -> None:
    shutil.copytree(path, tmp_path / path.name)
    (tmp_path / "page.py").write_text(code_of(PAGES[name]), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-W", "error", "page.py"],
        cwd=tmp_path,
        env={**os.environ, "GRASP_FACTORY_CACHE": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    if name in CHECKS:
        CHECKS[name](done.stdout)


def test_the_pages_that_are_checked_have_code() -> None:
    assert set(CHECKS) <= set(PAGES)
    assert len(PAGES) > 8


def test_the_policy_of_the_readme_aims_at_the_target() -> None:
    with World() as world:
        scene = build_scene(world, cube_spec())
        view = observe(scene, take_images(scene))
    blocks = BLOCK.findall((REPOSITORY / "README.md").read_text(encoding="utf-8"))
    (code,) = [block for block in blocks if "def plan" in block]
    scope: dict[str, object] = {}
    exec(code, scope)
    plan = scope["plan"](view, np.random.default_rng(0), None)
    aim = plan.grasps[0].T_world_tcp[:2, 3]
    assert aim == pytest.approx([0.55, 0.05], abs=0.03)


@pytest.mark.parametrize(
    ("page", "file", "name"),
    [
        ("README.md", "my_file.py", "plan"),
        ("docs/guides/extending.md", "my_policy.py", "plan"),
        ("docs/guides/extending.md", "my_robot.py", "ROBOT"),
        ("docs/guides/extending.md", "my_set.py", "SET"),
    ],
)
def test_code_of_a_page_for_a_file_passes_the_checks_as_it_stands(
    page: str, file: str, name: str, tmp_path: Path
) -> None:
    blocks = BLOCK.findall((REPOSITORY / page).read_text(encoding="utf-8"))
    (code,) = [block for block in blocks if block.startswith(f"# {file}\n")]
    (tmp_path / file).write_text(code, encoding="utf-8")
    try:
        _, row = row_named(f"{tmp_path / file}:{name}")
        assert [found for found in results(checks_of(row)) if found.fault] == []
    finally:
        forget_plugins()
