"""The collision hulls of the arm's links are those of its meshes."""

from __future__ import annotations

import numpy as np
import pytest

from grasp_factory.simulation.make_link_hulls import HULLS, LINKS, MESHES, hull_text


@pytest.mark.parametrize("link", LINKS)
class TestLinkHulls:
    def test_the_file_is_what_the_script_makes(self, link: str) -> None:
        pytest.importorskip("trimesh")
        assert (HULLS / f"{link}.obj").read_text(encoding="utf-8") == hull_text(link)

    def test_it_is_the_meshs_hull_within_a_millimetre(self, link: str) -> None:
        trimesh = pytest.importorskip("trimesh")
        mesh = trimesh.load(MESHES / f"{link}.stl").vertices
        hull = trimesh.load(HULLS / f"{link}.obj").vertices
        ways = np.random.default_rng(0).normal(size=(2000, 3))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        short = (mesh @ ways.T).max(axis=0) - (hull @ ways.T).max(axis=0)
        assert -1e-4 < short.min() and short.max() < 0.0011
