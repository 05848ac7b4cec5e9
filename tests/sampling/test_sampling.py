from __future__ import annotations

import dataclasses
import math
import struct
from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.scale import scaled, soak_only

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.randomization import RANDOMIZE_PRESETS
from grasp_factory.core.config.scene import ClutterConfig, WorkspaceConfig
from grasp_factory.core.episode import EpisodeSpec
from grasp_factory.core.geometry import apply
from grasp_factory.core.splits import SPLITS, split_of
from grasp_factory.errors import ConfigError, RecipeError, UnknownNameError
from grasp_factory.factory.name_check import check_names
from grasp_factory.objects import OBJECT_SETS, ObjectModel, draw_of
from grasp_factory.sampling import spec as sampling
from grasp_factory.sampling.spec import Stream, rng_for, sample_spec

CONFIG = FactoryConfig(seed=7)
SEEDS = st.integers(0, 2**63 - 1)
INDICES = st.integers(0, 2**40)
DRAWS = 2000
STRONG = FactoryConfig(
    seed=7, randomize=RANDOMIZE_PRESETS["strong"], clutter=ClutterConfig(count=3)
)
PINNED = {
    "OBJECTS": 10424841047235941500,
    "POSE": 6729429447121830309,
    "POLICY_CHOICE": 2312727446129763639,
    "POLICY": 102324644183451488,
    "CLUTTER": 9865082629080446798,
    "BODIES": 5305202858758359028,
    "OBJECT_LOOKS": 13848349293074425627,
    "MOTION": 2818583642635466886,
    "SURROUNDINGS_CHOICE": 12313260573587598750,
    "SURROUNDINGS": 7690163157938700377,
    "CAMERAS": 10331937841248093247,
}
"""The first raw draw of each stream of seed 0, episode 0."""


def specs(config: FactoryConfig, count: int = 40) -> list[EpisodeSpec]:
    return [sample_spec(config, index) for index in range(count)]


def objects(recipes: Sequence[EpisodeSpec]) -> list[str]:
    return [spec.objects[0].object_id for spec in recipes]


def poses(recipes: Sequence[EpisodeSpec]) -> list[object]:
    return [spec.objects[0].drop_pose for spec in recipes]


def orientations(recipes: Sequence[EpisodeSpec]) -> list[object]:
    return [spec.objects[0].drop_pose.quat_xyzw for spec in recipes]


def policies(recipes: Sequence[EpisodeSpec]) -> list[str]:
    return [spec.policy for spec in recipes]


def bits(spec: EpisodeSpec) -> bytes:
    pose = spec.objects[0].drop_pose
    return struct.pack("<7d", *pose.position, *pose.quat_xyzw)


class TestSeeds:
    @given(SEEDS, INDICES)
    def test_the_same_seed_and_index_give_the_same_recipe(self, seed: int, index: int) -> None:
        config = FactoryConfig(seed=seed)
        first, second = sample_spec(config, index), sample_spec(config, index)
        assert first == second
        assert (first.seed, first.index) == (seed, index)

    def test_the_order_of_calls_does_not_matter(self) -> None:
        forward = specs(CONFIG)
        backward = [sample_spec(CONFIG, index) for index in reversed(range(len(forward)))]
        assert forward == backward[::-1]

    def test_the_global_generator_does_not_matter(self) -> None:
        np.random.seed(1)
        first = sample_spec(CONFIG, 3)
        untouched = np.random.random()
        np.random.seed(1)
        assert np.random.random() == untouched
        assert sample_spec(CONFIG, 3) == first

    def test_seed_zero_is_a_seed(self) -> None:
        zero = FactoryConfig(seed=0)
        assert specs(zero) == specs(zero)
        assert poses(specs(zero)) != poses(specs(FactoryConfig(seed=1)))

    def test_different_indices_differ(self) -> None:
        assert len(set(poses(specs(CONFIG)))) == 40

    def test_different_seeds_differ(self) -> None:
        drawn = {bits(sample_spec(FactoryConfig(seed=seed), 0)) for seed in range(40)}
        assert len(drawn) == 40

    def test_seed_and_index_are_not_interchangeable(self) -> None:
        a, b = sample_spec(FactoryConfig(seed=1), 2), sample_spec(FactoryConfig(seed=2), 1)
        assert bits(a) != bits(b)

    def test_every_purpose_has_a_stream_of_its_own(self) -> None:
        first = {stream: rng_for(3, 5, stream).random() for stream in Stream}
        assert len(set(first.values())) == len(Stream)

    def test_what_a_seed_means_stays(self) -> None:
        drawn = {s.name: int(rng_for(0, 0, s).bit_generator.random_raw()) for s in Stream}
        assert drawn == PINNED


def others(recipes: Sequence[EpisodeSpec]) -> list[object]:
    return [[o.object_id for o in spec.objects[1:]] for spec in recipes]


def scales(recipes: Sequence[EpisodeSpec]) -> list[object]:
    return [[o.scale for o in spec.objects] for spec in recipes]


def colors(recipes: Sequence[EpisodeSpec]) -> list[object]:
    return [[(o.color, o.texture) for o in spec.objects] for spec in recipes]


def motions(recipes: Sequence[EpisodeSpec]) -> list[object]:
    return [spec.motion for spec in recipes]


def surroundings(recipes: Sequence[EpisodeSpec]) -> list[object]:
    return [spec.surroundings for spec in recipes]


def cameras(recipes: Sequence[EpisodeSpec]) -> list[object]:
    return [spec.cameras for spec in recipes]


class TestStreams:
    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("stream", "changes"),
        [
            (Stream.OBJECTS, objects),
            (Stream.POSE, orientations),
            (Stream.POLICY_CHOICE, policies),
            (Stream.POLICY, None),
            (Stream.CLUTTER, others),
            (Stream.BODIES, scales),
            (Stream.OBJECT_LOOKS, colors),
            (Stream.MOTION, motions),
            (Stream.SURROUNDINGS, surroundings),
            (Stream.CAMERAS, cameras),
        ],
        ids=lambda value: getattr(value, "name", ""),
    )
    def test_a_draw_added_to_one_stream_does_not_shift_the_others(
        self,
        monkeypatch: pytest.MonkeyPatch,
        stream: Stream,
        changes: Callable[[Sequence[EpisodeSpec]], list[object]] | None,
    ) -> None:
        aspects = (
            objects, orientations, policies, others, scales, colors, motions, surroundings, cameras
        )  # fmt: skip
        recipes_before = specs(STRONG)

        def burnt(seed: int, index: int, of: Stream, name: str = "") -> np.random.Generator:
            rng = rng_for(seed, index, of, name)
            if of is stream:
                rng.random()
            return rng

        monkeypatch.setattr(sampling, "rng_for", burnt)
        recipes_now = specs(STRONG)
        for aspect in aspects:
            if aspect is others and stream is Stream.OBJECTS:
                continue  # they belong to the target's split, whichever that is
            is_other = aspect(recipes_now) != aspect(recipes_before)
            assert is_other == (aspect is changes)

    def test_other_policy_weights_leave_objects_and_poses_alone(self) -> None:
        other = FactoryConfig(seed=7, policies={"top_down": 1.0})
        assert policies(specs(other)) != policies(specs(CONFIG))
        assert objects(specs(other)) == objects(specs(CONFIG))
        assert poses(specs(other)) == poses(specs(CONFIG))

    def test_other_object_sets_leave_policies_and_orientations_alone(self) -> None:
        other = FactoryConfig(seed=7, object_sets={"classic": 1.0})
        assert objects(specs(other)) != objects(specs(CONFIG))
        assert policies(specs(other)) == policies(specs(CONFIG))
        assert orientations(specs(other)) == orientations(specs(CONFIG))

    def test_another_workspace_leaves_objects_policies_and_orientations_alone(self) -> None:
        other = FactoryConfig(seed=7, workspace=WorkspaceConfig(lower=(0.3, -0.3, 0.0)))
        assert poses(specs(other)) != poses(specs(CONFIG))
        for aspect in (objects, policies, orientations):
            assert aspect(specs(other)) == aspect(specs(CONFIG))


class TestRecipe:
    @given(SEEDS, INDICES)
    def test_json_gives_the_recipe_back_bit_by_bit(self, seed: int, index: int) -> None:
        spec = sample_spec(FactoryConfig(seed=seed), index)
        text = spec.to_json()
        back = EpisodeSpec.from_json(text)
        assert back == spec
        assert bits(back) == bits(spec)
        assert back.to_json() == text

    def test_the_config_is_in_the_recipe(self) -> None:
        spec = sample_spec(CONFIG, 0)
        for name in ("robot", "cameras", "resolution", "record_hz", "workspace",
                     "physics", "motion", "label"):  # fmt: skip
            assert getattr(spec, name) == getattr(CONFIG, name)

    def test_the_object_is_described_as_in_its_set(self) -> None:
        for spec in specs(CONFIG):
            (target,) = spec.objects
            model = OBJECT_SETS[target.object_set].model(target.object_id)
            for name in ("split", "mass", "lateral_friction"):
                assert getattr(target, name) == getattr(model, name)

    @given(SEEDS, INDICES)
    def test_bounding_boxes_hang_above_the_table_with_their_middle_in_the_workspace(
        self, seed: int, index: int
    ) -> None:
        space = WorkspaceConfig()
        (target,) = sample_spec(FactoryConfig(seed=seed), index).objects
        model = OBJECT_SETS[target.object_set].model(target.object_id)
        corners = apply(target.drop_pose.matrix(), model.corners())
        lowest = corners[:, 2].min()
        assert space.drop_height[0] - 1e-9 <= lowest <= space.drop_height[1] + 1e-9
        middle = (corners.min(axis=0) + corners.max(axis=0))[:2] / 2.0
        assert (middle >= np.array(space.lower[:2]) + space.margin - 1e-9).all()
        assert (middle <= np.array(space.upper[:2]) - space.margin + 1e-9).all()

    @pytest.mark.slow
    def test_orientations_favour_no_direction(self) -> None:
        drawn = [spec.objects[0].drop_pose.matrix()[:3, :3] for spec in specs(CONFIG, DRAWS)]
        # An entry of a uniform rotation has mean 0 and variance 1/3.
        np.testing.assert_allclose(np.mean(drawn, axis=0), 0.0, atol=4.0 / math.sqrt(3 * DRAWS))
        np.testing.assert_allclose(np.mean(np.square(drawn), axis=0), 1 / 3, atol=0.03)

    @pytest.mark.slow
    def test_drop_places_fill_the_workspace(self) -> None:
        config = FactoryConfig(object_sets={"classic": 1.0})
        xy = np.array([spec.objects[0].drop_pose.position[:2] for spec in specs(config, DRAWS)])
        # Uniform within the margins, up to the objects' own offsets from their middle.
        counts, _, _ = np.histogram2d(*xy.T, bins=(2, 2), range=((0.47, 0.63), (-0.15, 0.15)))
        assert counts.min() > DRAWS / 4 * 0.8


class TestWeights:
    @pytest.mark.slow
    def test_names_are_drawn_by_weight(self) -> None:
        config = FactoryConfig(
            policies={"uniform": 3.0, "top_down": 1.0}, object_sets={"blobs": 0.8, "classic": 0.2}
        )
        drawn = specs(config, DRAWS)
        for counts, name, share in (
            (Counter(spec.policy for spec in drawn), "uniform", 0.75),
            (Counter(spec.objects[0].object_set for spec in drawn), "blobs", 0.8),
        ):
            deviation = math.sqrt(DRAWS * share * (1 - share))
            assert counts.total() == DRAWS
            assert abs(counts[name] - DRAWS * share) < 4 * deviation

    @pytest.mark.slow
    def test_objects_of_a_set_are_drawn_evenly(self) -> None:
        config = FactoryConfig(object_sets={"classic": 1.0})
        counts = Counter(spec.objects[0].object_id for spec in specs(config, DRAWS))
        expected = DRAWS / 9
        chi_square = sum((count - expected) ** 2 / expected for count in counts.values())
        assert len(counts) == 9
        assert chi_square < 26.1  # eight degrees of freedom: exceeded once in a thousand

    def test_a_weight_of_zero_is_never_drawn(self) -> None:
        for policies_ in ({"top_down": 0.0, "uniform": 1.0}, {"top_down": 1.0, "uniform": 0.0}):
            (name,) = (name for name, weight in policies_.items() if weight)
            assert set(policies(specs(FactoryConfig(policies=policies_)))) == {name}

    def test_the_order_of_names_does_not_matter(self) -> None:
        turned = FactoryConfig(
            seed=7,
            policies=dict(reversed(CONFIG.policies.items())),
            object_sets=dict(reversed(CONFIG.object_sets.items())),
        )
        assert list(turned.policies) != list(CONFIG.policies)
        assert specs(turned) == specs(CONFIG)

    def test_only_the_ratio_of_weights_matters(self) -> None:
        few = FactoryConfig(seed=7, policies={"uniform": 1.0, "top_down": 3.0})
        many = FactoryConfig(seed=7, policies={"uniform": 8.0, "top_down": 24.0})
        assert specs(few) == specs(many)

    def test_an_unknown_object_set_is_named_with_the_valid_ones(self) -> None:
        config = FactoryConfig(object_sets={"blob": 1.0})
        expected = "unknown object set 'blob'; did you mean 'blobs'.*valid: .*blobs, .*classic"
        with pytest.raises(UnknownNameError, match=expected):
            sample_spec(config, 0)


class TestSplits:
    """An object belongs to a split for ever, and so does an episode with all that lies in it."""

    @pytest.mark.slow
    @pytest.mark.parametrize("count", [1, 4])
    @pytest.mark.parametrize("object_sets", [{"procedural": 1.0}, FactoryConfig().object_sets])
    def test_no_object_occurs_in_two_splits(
        self, count: int, object_sets: dict[str, float]
    ) -> None:
        config = FactoryConfig(object_sets=object_sets, clutter=ClutterConfig(count=count))
        seen: dict[str, set[str]] = {"train": set(), "val": set(), "test": set()}
        for seed in (0, 1):
            for spec in specs(dataclasses.replace(config, seed=seed), scaled(40, 300)):
                seen[spec.objects[0].split] |= {recipe.object_id for recipe in spec.objects}
        assert all(seen.values())
        assert not seen["train"] & seen["test"]
        assert not seen["train"] & seen["val"]
        assert not seen["val"] & seen["test"]

    @pytest.mark.slow
    @pytest.mark.parametrize("splits", [("val", "test"), *soak_only(("train",), ("test",))])
    def test_objects_are_of_the_splits_that_are_asked_for(self, splits: tuple[str, ...]) -> None:
        config = FactoryConfig(object_splits=splits, clutter=ClutterConfig(count=3))
        drawn = specs(config, 200)
        assert {spec.objects[0].split for spec in drawn} == set(splits)
        assert {recipe.split for spec in drawn for recipe in spec.objects} == set(splits)
        shares = Counter(spec.objects[0].object_set for spec in drawn)
        assert abs(shares["procedural"] - 100) < 29  # four sigma: the sets keep their shares

    @pytest.mark.soak
    @pytest.mark.slow
    def test_all_objects_of_a_split_are_drawn_from_a_set_that_lists_them(self) -> None:
        config = FactoryConfig(object_splits=("test",), object_sets={"blobs": 1.0})
        models = OBJECT_SETS["blobs"].models.values()  # type: ignore[attr-defined]
        of_test = {model.object_id for model in models if model.split == "test"}
        drawn = Counter(spec.objects[0].object_id for spec in specs(config, DRAWS))
        assert len(drawn) > 0.95 * len(of_test)
        assert set(drawn) <= of_test

    def test_naming_all_splits_draws_what_the_sets_draw(self) -> None:
        for name, found in OBJECT_SETS.items():
            for seed in range(20):
                one, other = (np.random.default_rng(seed) for _ in range(2))
                assert draw_of(found, SPLITS, one) == found.draw(other), name
                assert one.random() == other.random()

    def test_every_object_is_of_one_of_the_splits(self) -> None:
        assert {split_of(f"any/{i}") for i in range(200)} == set(SPLITS)

    def test_a_set_without_an_object_of_the_splits_is_named_at_the_start(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(ObjectModel, "split", property(lambda model: "train"))
        sets = {"classic": 1.0, "procedural": 1.0}
        config = FactoryConfig(object_sets=sets, object_splits=("val", "test"))
        with pytest.raises(ConfigError) as caught:
            check_names(config)
        assert str(caught.value) == (
            "object_splits: got val, test, of which object set 'classic' has no object; valid with"
            " it: train; or leave the set out"
        )
        check_names(dataclasses.replace(config, object_sets={"classic": 0.0, "procedural": 1.0}))
        with pytest.raises(RecipeError, match="none of 500 objects drawn from set 'procedural'"):
            draw_of(OBJECT_SETS["procedural"], ("test",), np.random.default_rng(0))

    def test_where_a_set_has_no_other_object_of_the_split_the_target_falls_twice(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        alone = {"classic/cube": "test"}
        monkeypatch.setattr(
            ObjectModel, "split", property(lambda model: alone.get(model.object_id, "train"))
        )
        config = FactoryConfig(object_sets={"classic": 1.0}, clutter=ClutterConfig(count=3))
        of_test = [spec for spec in specs(config, 60) if spec.objects[0].split == "test"]
        assert of_test
        for spec in of_test:
            assert {recipe.object_id for recipe in spec.objects} == {"classic/cube"}
