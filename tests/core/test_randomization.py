from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.core.appearance import Surroundings
from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.randomization import RANDOMIZE_PRESETS, RandomizeConfig
from grasp_factory.core.config.scene import ClutterConfig
from grasp_factory.core.episode import EpisodeSpec
from grasp_factory.core.serialization import to_plain
from grasp_factory.core.textures import TEXTURES
from grasp_factory.errors import ConfigError
from grasp_factory.factory.run_request import resolve_request
from grasp_factory.sampling.spec import sample_spec

ALL_CAMERAS = {name: camera.config for name, camera in CAMERAS.items()}
INDICES = st.integers(0, 10**9)


def config(preset: str = "none", **more: Any) -> FactoryConfig:
    return FactoryConfig(randomize=RANDOMIZE_PRESETS[preset], **more)


def without_looks(spec: EpisodeSpec) -> EpisodeSpec:
    plain = [dataclasses.replace(o, color=None, texture="") for o in spec.objects]
    return dataclasses.replace(spec, surroundings=Surroundings(), objects=tuple(plain))


def with_set(*assignments: str) -> FactoryConfig:
    return resolve_request({}, {}, assignments).config


class TestPresets:
    def test_none_is_the_default_and_draws_nothing(self) -> None:
        assert RANDOMIZE_PRESETS["none"] == RandomizeConfig() == FactoryConfig().randomize
        spec = sample_spec(config(cameras=ALL_CAMERAS), 3)
        target = spec.objects[0]
        assert spec.cameras == ALL_CAMERAS
        assert spec.motion == FactoryConfig().motion
        assert (target.scale, target.linear_damping, target.angular_damping) == (1.0, 0.0, 0.0)
        assert (target.color, target.texture) == (None, "")
        assert spec.surroundings.table == Surroundings().table
        assert spec.surroundings == sample_spec(config(), 4).surroundings

    @given(INDICES)
    def test_looks_changes_looks_alone(self, index: int) -> None:
        plain, looks = (sample_spec(config(p, clutter=ClutterConfig(count=3)), index)
                        for p in ("none", "looks"))  # fmt: skip
        assert looks != plain
        assert without_looks(looks) == without_looks(plain)

    def test_strong_has_the_looks_of_looks(self) -> None:
        for index in range(20):
            looks, strong = (sample_spec(config(p), index) for p in ("looks", "strong"))
            assert strong.surroundings == looks.surroundings
            assert strong.objects[0].color == looks.objects[0].color
            assert strong.objects[0].texture == looks.objects[0].texture

    @pytest.mark.parametrize("preset", RANDOMIZE_PRESETS)
    def test_a_preset_may_stand_for_the_section_and_be_refined(self, preset: str) -> None:
        named = with_set(f"randomize={preset}")
        assert named.randomize == RANDOMIZE_PRESETS[preset]
        refined = with_set(f"randomize={preset}", "randomize.objects.scale=[0.5, 2]")
        assert refined.randomize.objects.scale == (0.5, 2.0)
        assert refined.randomize.looks == named.randomize.looks

    def test_a_file_may_refine_a_part_of_a_section(self) -> None:
        file = {"randomize": {"objects": {"mass": [0.5, 2.0]}}, "clutter": 3, "cameras": ["wrist"]}
        request = resolve_request(file, {"randomize": "light"})
        assert request.config.randomize == RANDOMIZE_PRESETS["light"]  # the flag wins
        request = resolve_request(file, {})
        assert request.config.randomize.objects.mass == (0.5, 2.0)
        assert request.config.randomize.looks == RandomizeConfig().looks
        assert request.config.clutter.count == 3
        assert request.config.cameras == {"wrist": CAMERAS["wrist"].config}

    def test_an_unknown_preset_is_refused_with_all_names(self) -> None:
        with pytest.raises(KeyError, match=r"unknown preset of randomize 'stong'.*did you mean"):
            with_set("randomize=stong")


class TestDraws:
    @given(INDICES)
    def test_every_draw_of_strong_lies_in_its_range(self, index: int) -> None:
        ranges = RANDOMIZE_PRESETS["strong"]
        base = config("strong", cameras=ALL_CAMERAS, clutter=ClutterConfig(count=4))
        spec, plain = sample_spec(base, index), FactoryConfig().motion
        for recipe in spec.objects:
            assert ranges.objects.scale[0] <= recipe.scale <= ranges.objects.scale[1]
            assert 0.0 <= recipe.linear_damping <= ranges.objects.linear_damping[1]
            assert recipe.texture == "" or recipe.texture in TEXTURES
            assert recipe.color is None or all(0.0 <= c <= 1.0 for c in recipe.color)
        low, high = ranges.gripper.force
        assert low <= spec.motion.grip_force / plain.grip_force <= high
        factor = spec.motion.lift_speed / plain.lift_speed
        assert ranges.gripper.speed[0] <= factor <= ranges.gripper.speed[1]
        assert spec.motion.closing_speed / plain.closing_speed == pytest.approx(factor)
        jitter = ranges.cameras
        for name in ("front", "overhead"):
            camera, nominal = spec.cameras[name], ALL_CAMERAS[name]
            moved = np.abs(np.subtract(camera.eye, nominal.eye))
            assert (moved <= jitter.eye).all()
            assert abs(camera.fov_y_deg - nominal.fov_y_deg) <= jitter.fov_y_deg
        on_hand = np.subtract(spec.cameras["wrist"].eye, ALL_CAMERAS["wrist"].eye)
        assert (np.abs(on_hand) <= 0.1 * jitter.eye).all()
        light = spec.surroundings.light
        assert np.linalg.norm(light.direction) == pytest.approx(1.0)
        elevation = math.degrees(math.asin(min(1.0, light.direction[2])))
        assert 20.0 - 1e-6 <= elevation <= 90.0

    def test_factors_spread_over_their_range_evenly_in_the_logarithm(self) -> None:
        specs = [sample_spec(config("strong"), i) for i in range(400)]
        low, high = np.log(RANDOMIZE_PRESETS["strong"].objects.scale)
        shares = (np.log([spec.objects[0].scale for spec in specs]) - low) / (high - low)
        assert np.histogram(shares, bins=4, range=(0, 1))[0].min() > 60

    def test_a_recipe_with_everything_drawn_survives_json(self) -> None:
        drawn = config("strong", cameras=ALL_CAMERAS, clutter=ClutterConfig(count=5), video_hz=10)
        for index in range(20):
            spec = sample_spec(drawn, index)
            again = EpisodeSpec.from_json(spec.to_json())
            assert again == spec
            assert list(again.cameras) == list(spec.cameras)  # their order decides how views fuse

    def test_one_more_camera_leaves_the_others_where_they_are(self) -> None:
        few, all_of_them = (
            sample_spec(config("strong", cameras=cameras), 5).cameras
            for cameras in ({"wrist": ALL_CAMERAS["wrist"]}, ALL_CAMERAS)
        )
        assert few["wrist"] == all_of_them["wrist"]

    def test_one_kind_of_draw_does_not_move_another(self) -> None:
        plain, strong = config(), config("strong")
        for index in range(20):
            a, b = sample_spec(plain, index), sample_spec(strong, index)
            assert a.policy == b.policy
            assert a.objects[0].object_id == b.objects[0].object_id
            assert a.objects[0].drop_pose.quat_xyzw == b.objects[0].drop_pose.quat_xyzw


class TestSurroundings:
    def test_a_number_of_surroundings_is_shared_by_all_episodes(self) -> None:
        ranges = dataclasses.replace(RANDOMIZE_PRESETS["strong"], surroundings=5)
        specs = [sample_spec(FactoryConfig(randomize=ranges), i) for i in range(200)]
        found = {(str(spec.surroundings), str(spec.cameras)) for spec in specs}
        assert len(found) == 5

    def test_without_a_number_each_episode_has_its_own(self) -> None:
        specs = [sample_spec(config("strong"), i) for i in range(50)]
        assert len({str(spec.surroundings) for spec in specs}) == 50


class TestRefusals:
    @pytest.mark.parametrize(
        ("assignment", "words"),
        [
            ("randomize.objects.scale=[2, 1]", "scale: got [2.0, 1.0], valid: 0.25 <= low <= high"),
            ("randomize.objects.mass=[0, 1]", "mass: got [0.0, 1.0]"),
            ("randomize.objects.scale=1.5", "expected a list, got 1.5"),
            ("randomize.looks.object_color.hue=[0, 2]", "hue: got [0.0, 2.0]"),
            ("randomize.looks.table_texture=1.5", "table_texture: got 1.5, valid: 0.0 to 1.0"),
            ("randomize.looks.light_elevation_deg=[0, 90]", "light_elevation_deg"),
            ("randomize.cameras.eye=-1", "eye: got -1.0, valid: 0.0 to 1.0 m"),
            ("randomize.cameras.fov_y_deg=40", "randomize.cameras.fov_y_deg: got 40.0"),
            ("randomize.gripper.force=[0.1, 10.5]", "force: got [0.1, 10.5]"),
            ("randomize.gripper.strength=[1, 2]", "unknown key 'randomize.gripper.strength'"),
            ("randomize.surroundings=-1", "surroundings: got -1"),
            ("clutter=0", "count: got 0, valid: 1 to 10"),
            ("clutter.radius=2", "radius: got 2.0"),
            ("cameras=[fornt]", "unknown camera 'fornt'; did you mean 'front'?"),
            ("video_hz=7", "video_hz: got 7, valid: a divisor of physics.free_hz (240)"),
            (
                "video_hz=120",
                "video_hz: got 120, valid: less: a block's videos would take up to 7 GB",
            ),
            ("cameras.front.mount=hand", "mount: got 'hand', valid: world, tcp"),
        ],
    )
    def test_a_wrong_value_is_named_with_what_is_valid(self, assignment: str, words: str) -> None:
        with pytest.raises((ConfigError, KeyError)) as caught:
            with_set(assignment)
        assert words in str(caught.value)

    def test_a_grip_that_no_motion_could_have_is_refused_before_any_episode(self) -> None:
        with pytest.raises(ConfigError, match=r"randomize\.gripper: with motion\.grip_force"):
            with_set("motion.grip_force=100", "randomize.gripper.force=[1, 5]")

    def test_the_longest_attempt_counts_with_the_slowest_speed(self) -> None:
        slow = with_set("randomize.gripper.speed=[0.5, 1]")
        assert slow.longest_attempt > 1.2 * FactoryConfig().longest_attempt

    def test_a_config_with_every_section_survives_plain_data(self) -> None:
        strong = config("strong", cameras=ALL_CAMERAS, clutter=ClutterConfig(count=5))
        assert FactoryConfig.from_plain(to_plain(strong)) == strong
