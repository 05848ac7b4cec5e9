"""The wheel has all that the package needs, and works where there is no checkout."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
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
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the wheel from a copy, because building writes into the source."""
    folder = tmp_path_factory.mktemp("wheel")
    for name in ("setup.cfg", "pyproject.toml", "README.md", "LICENSE", "MANIFEST.in"):
        (folder / "source").mkdir(exist_ok=True)
        shutil.copy(REPOSITORY / name, folder / "source" / name)
    for name in ("grasp_factory", "tests/support"):
        unwanted = shutil.ignore_patterns("__pycache__")
        shutil.copytree(REPOSITORY / name, folder / "source" / name, ignore=unwanted)
    options = ("--no-deps", "--no-build-isolation", "--wheel-dir", folder)
    subprocess.run([*PIP, "wheel", *options, folder / "source"], check=True)
    (found,) = folder.glob("*.whl")
    return found


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
    run(program, "verify", "s.zarr", "--deep", "1")
    code = (
        "import grasp_factory; ds = grasp_factory.Dataset('s.zarr');"
        "print(grasp_factory.__file__, *(ds[i].checksum() for i in range(4)))"
    )
    home, *checksums = run(python, "-I", "-c", code).split()
    assert Path(home) == site_packages(tmp_path / "venv") / "grasp_factory" / "__init__.py"
    assert checksums == Dataset(tmp_path / "s.zarr").column("checksum").tolist()
