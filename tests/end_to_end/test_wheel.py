"""The source distribution and its wheel have all that is needed, and work without a checkout."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
from support.environments import environment, site_packages
from support.places import REPOSITORY

from grasp_factory.dataset.dataset import Dataset

pytestmark = pytest.mark.slow

PIP = (sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check")
PACKAGE = REPOSITORY / "grasp_factory"
SHIPPED = ("robots/assets/*", "objects/assets/*.obj", "objects/blobs.csv")
SHIPPED += ("apps/browse/static/*.*", "apps/browse/static/vendor/*")
"""Files beside the modules."""


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make the source distribution of a clone and return it unpacked."""
    folder = tmp_path_factory.mktemp("source")
    subprocess.run(["git", "clone", "--quiet", REPOSITORY, folder / "clone"], check=True)
    shutil.rmtree(folder / "clone" / "grasp_factory")
    unwanted = shutil.ignore_patterns("__pycache__")
    shutil.copytree(PACKAGE, folder / "clone" / "grasp_factory", ignore=unwanted)
    code = f"from setuptools import build_meta; build_meta.build_sdist({str(folder)!r})"
    command = [sys.executable, "-c", code]
    subprocess.run(command, cwd=folder / "clone", check=True, capture_output=True)
    (packed,) = folder.glob("*.tar.gz")
    with tarfile.open(packed) as file:
        file.extractall(folder, filter="data")
    return folder / packed.name.removesuffix(".tar.gz")


@pytest.fixture(scope="module")
def wheel(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make the wheel of the source distribution."""
    folder = tmp_path_factory.mktemp("wheel")
    options = ("--no-deps", "--no-build-isolation", "--wheel-dir", folder)
    subprocess.run([*PIP, "wheel", *options, source], check=True)
    (found,) = folder.glob("*.whl")
    return found


def test_the_source_distribution_has_all_that_tests_and_pages_need(source: Path) -> None:
    kinds = ["bin", "data_samples", "docs", "tests", "*.md", "LICENSE", ":!.github", ":!packaging"]
    command = ["git", "ls-files", *kinds]
    listed = subprocess.run(command, cwd=REPOSITORY, check=True, capture_output=True, text=True)
    names = [name for name in listed.stdout.splitlines() if (REPOSITORY / name).exists()]
    assert len(names) > 500
    assert [name for name in names if not (source / name).exists()] == []


def test_it_has_every_module_and_every_file_beside_them_and_no_tests(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as file:
        names = {name for name in file.namelist() if ".dist-info/" not in name}
    modules = {path.relative_to(REPOSITORY) for path in PACKAGE.rglob("*.py")}
    beside = {
        path.relative_to(REPOSITORY)
        for pattern in SHIPPED
        for path in PACKAGE.glob(pattern)
        if path.is_file()
    }
    assert len(beside) > 50
    assert names == {str(path) for path in (*modules, *beside)} | {"grasp_factory/py.typed"}


def test_it_makes_reads_and_checks_episodes_where_there_is_no_checkout(
    wheel: Path, tmp_path: Path
) -> None:
    python = environment(tmp_path / "venv", without=("grasp_factory", "__editable__"))
    variables = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}

    def run(*command: str | Path) -> str:
        done = subprocess.run(
            command, cwd=tmp_path, env=variables, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    run(python, *PIP[1:], "install", "--no-deps", "--no-index", wheel)
    program = python.with_name("grasp-factory")
    run(program, "generate", "--n", "4", "--resolution", "64x48", "--quiet", "--out", "s.zarr")
    run(program, "info", "s.zarr")
    run(program, "sheet", "s.zarr", "sheet.png")
    run(program, "verify", "s.zarr", "--deep", "1")
    run(program, "export", "s.zarr", "article", "--to", "article")
    code = (
        "import grasp_factory; ds = grasp_factory.Dataset('s.zarr');"
        "print(grasp_factory.__file__, *(ds[i].checksum() for i in range(4)))"
    )
    home, *checksums = run(python, "-I", "-c", code).split()
    assert Path(home) == site_packages(tmp_path / "venv") / "grasp_factory" / "__init__.py"
    assert checksums == Dataset(tmp_path / "s.zarr").column("checksum").tolist()
