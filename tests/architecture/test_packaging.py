"""What is written down more than once about the package says the same everywhere."""

from __future__ import annotations

import configparser
import re
from pathlib import Path

import pytest
import yaml

from grasp_factory import __version__

REPOSITORY = Path(__file__).resolve().parents[2]
DOCS = REPOSITORY / "docs"
CONDA_NAMES = {"opencv-python-headless": "py-opencv", "pyyaml": "pyyaml"}


def setup() -> configparser.ConfigParser:
    found = configparser.ConfigParser()
    found.read(REPOSITORY / "setup.cfg")
    return found


def requirements() -> dict[str, str]:
    """Return the bounds of each library that the package needs."""
    lines = setup()["options"]["install_requires"].split("\n")
    named = [re.match(r"([\w-]+)([^;]*)", line) for line in lines if line and line[0] != "#"]
    return {found[1].lower(): found[2].strip() for found in named if found}


def test_each_extra_is_listed_and_may_be_installed() -> None:
    page = (DOCS / "guides" / "installing.md").read_text(encoding="utf-8")
    extras = set(setup()["options.extras_require"])
    assert set(re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE)) == extras
    pages = [*DOCS.rglob("*.md"), REPOSITORY / "README.md"]
    named = re.findall(
        r"(?:factory|\.)\[([\w,]+)\]'", "".join(p.read_text(encoding="utf-8") for p in pages)
    )
    assert {extra for several in named for extra in several.split(",")} <= extras


@pytest.mark.parametrize("file", ["CITATION.cff", "packaging/conda/recipe.yaml"])
def test_the_version_is_that_of_the_package(file: str) -> None:
    assert f"version: {__version__}\n" in (REPOSITORY / file).read_text()


def test_the_conda_recipe_needs_what_the_package_needs() -> None:
    recipe = yaml.safe_load((REPOSITORY / "packaging/conda/recipe.yaml").read_text())
    listed = {line.split()[0]: line.split()[-1] for line in recipe["requirements"]["run"]}
    for name, bounds in requirements().items():
        expected = bounds.replace("==", "") + (".*" if "==" in bounds else "")
        assert listed[CONDA_NAMES.get(name, name)] == expected


def test_the_site_shows_every_page() -> None:
    shown = set(re.findall(r"\S+\.(?:md|ipynb)", (REPOSITORY / "mkdocs.yml").read_text()))
    pages = {*DOCS.rglob("*.md"), *DOCS.rglob("*.ipynb")}
    assert shown == {page.relative_to(DOCS).as_posix() for page in pages}


def test_the_container_copies_what_the_build_needs() -> None:
    copied = re.findall(r"^COPY (.+) \S+$", (REPOSITORY / "Dockerfile").read_text(), re.MULTILINE)
    names = [name for line in copied for name in line.split()]
    assert {"setup.cfg", "pyproject.toml", "MANIFEST.in", "README.md", "LICENSE"} <= {*names}
    assert all((REPOSITORY / name).exists() for name in names)
