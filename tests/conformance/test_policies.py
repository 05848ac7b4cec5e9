"""The contract of a policy, which every row of ``POLICIES`` keeps, for the gripper of every robot.

- The row has the policy's name, and all settings have defaults (but for a trained model).
- The same view, random generator and settings give the same plan.
- The view is left as it is.
- A target that nothing shows gives an empty plan; a single pixel of it is enough for a grasp.
- Only the target is grasped, and grasps move with it.
- A grasp is a rigid pose that approaches from above. Its open fingers stay above the table, and
  its width is above 0 and at most the gripper's.
- The grasp with the best score comes first.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.scale import scaled
from support.tiny_models import tiny_model
from support.views import GRIPPERS, brick, lowest_corner, make_view, plain, plan, tilt_deg

from grasp_factory.core.cache import VARIABLE, digest
from grasp_factory.core.enums import Label
from grasp_factory.core.episode import Grasp, SceneView
from grasp_factory.core.gripper import Gripper
from grasp_factory.policies import POLICIES, model_registry
from grasp_factory.policies.base import TIP_CLEARANCE

FARTHEST_TILT_DEG = 60.0
"""How far from straight down any policy may approach."""
TILT_DEG = {
    **{"uniform": 0.0, "top_down": 0.0, "antipodal": 30.0, "perturbed": 50.0, "mixture": 30.0},
    "learned": 0.0,
}
"""Policies that by default promise less; for ``perturbed`` 4.9 sigma."""
NEEDED = {"learned": {"model": digest(tiny_model(0))}}
"""Settings that have no default."""


def proposed(policy: str, view: SceneView, seed: int = 0) -> tuple[Grasp, ...]:
    return plan(policy, view, seed, **NEEDED.get(policy, {}))


def arrays(view: SceneView) -> list[NDArray[Any]]:
    images = [getattr(image, f.name) for image in view.images.values()
              for f in dataclasses.fields(image)]  # fmt: skip
    return [*images, view.joint_positions, view.T_world_tcp]


@pytest.mark.parametrize("gripper", GRIPPERS.values(), ids=GRIPPERS)
@pytest.mark.parametrize("policy", POLICIES)
class TestPolicy:
    @pytest.fixture(autouse=True, scope="class")
    @staticmethod
    def has_a_model(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv(VARIABLE, str(tmp_path_factory.mktemp("cache")))
            model_registry.keep(tiny_model(0))
            yield

    @pytest.fixture
    def view(self, gripper: Gripper) -> SceneView:
        return make_view(brick(0.55, 0.06, 0.4), gripper)

    def test_the_same_view_and_seed_give_the_same_plan(self, policy: str, view: SceneView) -> None:
        assert plain(proposed(policy, view, 3)) == plain(proposed(policy, view, 3))

    def test_the_view_is_left_alone(self, policy: str, view: SceneView) -> None:
        before = [array.copy() for array in arrays(view)]
        for array in arrays(view):
            array.flags.writeable = False
        proposed(policy, view)
        for array, was in zip(arrays(view), before, strict=True):
            np.testing.assert_array_equal(array, was)

    def test_an_unseen_target_gives_an_empty_plan(self, policy: str, gripper: Gripper) -> None:
        assert proposed(policy, make_view([], gripper)) == ()

    def test_a_single_pixel_of_the_target_is_enough_for_a_plan(
        self, policy: str, view: SceneView
    ) -> None:
        image = view.images["front"]
        v, u = np.argwhere(image.segmentation == Label.TARGET)[0]
        image.segmentation[image.segmentation == Label.TARGET] = Label.TABLE
        image.segmentation[v, u] = Label.TARGET
        assert proposed(policy, view)

    def test_other_objects_are_not_grasped(self, policy: str, gripper: Gripper) -> None:
        other = [(T, size, Label.TARGET + 1) for T, size, _ in brick(0.5, 0.1, 0.0)]
        assert proposed(policy, make_view(other, gripper)) == ()

    @pytest.mark.slow
    @pytest.mark.parametrize("height", [0.012, 0.05, 0.15])
    def test_grasps_are_rigid_within_their_tilt_and_off_the_table(
        self, policy: str, gripper: Gripper, height: float
    ) -> None:
        view = make_view(brick(0.5, 0.0, 1.1, (0.08, 0.03, height)), gripper)
        for seed in range(scaled(6, 20)):
            grasps = proposed(policy, view, seed)
            assert grasps
            for grasp in grasps:
                T = grasp.T_world_tcp
                np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
                assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
                np.testing.assert_array_equal(T[3], [0.0, 0.0, 0.0, 1.0])
                if TILT_DEG.get(policy, FARTHEST_TILT_DEG) == 0.0:
                    np.testing.assert_allclose(T[:3, 2], [0.0, 0.0, -1.0], atol=1e-12)
                assert tilt_deg(grasp) <= TILT_DEG.get(policy, FARTHEST_TILT_DEG) + 1e-4
                assert lowest_corner(grasp, gripper) >= TIP_CLEARANCE - 1e-12
                assert 0.0 < grasp.width <= gripper.max_width
                assert math.isfinite(grasp.score)

    def test_the_best_grasp_comes_first(self, policy: str, view: SceneView) -> None:
        scores = [grasp.score for grasp in proposed(policy, view)]
        assert scores == sorted(scores, reverse=True)

    def test_grasps_go_with_the_target(self, policy: str, gripper: Gripper) -> None:
        aims = []
        for y in (-0.1, 0.1):
            (first, *_) = proposed(policy, make_view(brick(0.55, y, 0.4), gripper), 5)
            aims.append(first.T_world_tcp[:3, 3])
        np.testing.assert_allclose(aims[1] - aims[0], [0.0, 0.2, 0.0], atol=0.006)
