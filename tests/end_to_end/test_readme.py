"""The README's generated table and its examples; run as a script, it writes the table anew."""

from __future__ import annotations

import re

import numpy as np
import pytest
from support.places import REPOSITORY
from support.scenes import cube_spec, take_images

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import Outcome, names
from grasp_factory.simulation.scene import build_scene, observe
from grasp_factory.simulation.world import World

README = REPOSITORY / "README.md"
TABLE = re.compile(r"(<!-- schema: .*? -->\n).*?(<!-- end of schema -->)", re.DOTALL)


EXAMPLE = re.compile(r"```python\n(.*?)```", re.DOTALL)


def with_table(text: str) -> str:
    return TABLE.sub(lambda m: f"{m[1]}{schema.markdown_table()}\n{m[2]}", text)


def test_the_stores_table_is_that_of_the_schema():
    text = README.read_text()
    assert TABLE.search(text)
    assert text == with_table(text), "run: python tests/test_readme.py"


def test_every_outcome_is_explained():
    text = README.read_text()
    assert [name for name in names(Outcome) if f"`{name}`" not in text] == []


def test_every_file_that_is_linked_exists():
    for page in (
        README,
        REPOSITORY / "CONTRIBUTING.md",
        *sorted((REPOSITORY / "docs").glob("*.md")),
    ):
        for target in re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text()):
            assert (page.parent / target).exists(), (page.name, target)


def test_the_example_policy_works_as_printed():
    with World() as world:
        scene = build_scene(world, cube_spec())
        view = observe(scene, take_images(scene))
    code = next(c for c in EXAMPLE.findall(README.read_text()) if "def plan" in c)
    scope: dict[str, object] = {}
    exec(f"from __future__ import annotations\n{code}", scope)  # MyParameters is the reader's
    plan = scope["plan"](view, np.random.default_rng(0), None)
    aim = plan.grasps[0].T_world_tcp[:2, 3]
    assert aim == pytest.approx([0.55, 0.05], abs=0.03)


def test_every_setting_in_the_examples_exists():
    for assignment in re.findall(r"--set (\S+)=", README.read_text()):
        value = FactoryConfig().to_plain()
        for part in assignment.split("."):
            value = value[part]


if __name__ == "__main__":
    README.write_text(with_table(README.read_text()))
