"""Episodes: the same bytes every time, honest physics, an outcome for every ending."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pybullet
import pytest
from support.scale import scaled
from support.scenes import SMALL, cube_spec, default_episodes

from grasp_factory.core.config.cameras import CameraConfig
from grasp_factory.core.enums import Label, Outcome, Phase
from grasp_factory.core.episode import EpisodeSpec, Grasp, GraspPlan
from grasp_factory.errors import RecipeError
from grasp_factory.labels.rule import judge, measure, target_com, touching
from grasp_factory.policies.base import Policy, PolicyError, looking_down
from grasp_factory.policies.top_down import TopDownParameters
from grasp_factory.robots import ROBOTS
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.simulation import rollout
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.simulation.world import World

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def world():
    with World() as world:
        yield world


def aiming(monkeypatch, *grasps):
    """Make the policy of ``cube_spec`` propose these grasps."""
    plan = GraspPlan(grasps=grasps)
    policy = Policy("top_down", "scripted", TopDownParameters, lambda view, rng, settings: plan)
    monkeypatch.setattr(rollout, "POLICIES", {"top_down": policy})


def grasp_at(x, y, z, yaw=np.pi / 2, width=0.1):
    return Grasp(T_world_tcp=looking_down(x, y, z, yaw), width=width)


class TestDeterminism:
    FRESH = """
import sys
from pathlib import Path
from grasp_factory.core.episode import EpisodeSpec
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.simulation.world import World
with World() as world:
    print(run_episode(world, EpisodeSpec.from_json(sys.stdin.read())).checksum())
"""

    def in_a_fresh_process(self, spec):
        return subprocess.run(
            [sys.executable, "-c", self.FRESH],
            input=spec.to_json(), capture_output=True, check=True, text=True,
        ).stdout.strip()  # fmt: skip

    @pytest.mark.soak
    def test_an_episode_has_the_same_bytes_in_a_fresh_process_and_after_twenty_others(self):
        late = default_episodes(22)[21]
        assert self.in_a_fresh_process(late.spec) == late.checksum()

    def test_episodes_do_not_depend_on_their_order(self, world):
        expected = [episode.checksum() for episode in default_episodes(6)]
        found = {i: run_episode(world, sample_spec(SMALL, i)).checksum() for i in (5, 0, 3, 1)}
        assert found == {i: expected[i] for i in found}

    @pytest.mark.parametrize("robot", ROBOTS)
    def test_a_spec_read_back_from_json_gives_the_same_bytes(self, world, robot):
        spec = dataclasses.replace(sample_spec(SMALL, 2), robot=robot)
        once = run_episode(world, spec).checksum()
        assert run_episode(world, EpisodeSpec.from_json(spec.to_json())).checksum() == once

    def test_the_checksum_sees_a_single_changed_bit(self):
        episode = default_episodes(1)[0]
        rgb = episode.cameras["front"].rgb.copy()
        rgb[0, 0, 0, 0] ^= 1
        frames = dataclasses.replace(episode.cameras["front"], rgb=rgb)
        changed = dataclasses.replace(episode, cameras={"front": frames})
        assert changed.checksum() != episode.checksum()


class TestHonesty:
    def test_no_pose_or_joint_is_set_after_the_scene_is_built(self, monkeypatch):
        calls = []
        sealed = World.seal

        def seal(world):
            sealed(world)
            for name in dir(pybullet):
                if name.startswith(("reset", "create", "load", "restore", "remove", "apply")):
                    monkeypatch.setattr(pybullet, name, lambda *a, _n=name, **k: calls.append(_n))

        monkeypatch.setattr(World, "seal", seal)
        with World() as world:
            episode = run_episode(world, cube_spec())
        assert episode.success
        assert calls == []

    def test_objects_and_arm_never_jump(self):
        for episode in default_episodes(20):
            if episode.n_steps < 2:
                continue
            streams = episode.streams
            for name in ("object_pose", "tcp_pose"):
                position = streams[name][..., :3].reshape(episode.n_steps, -1)
                # 4 m/s is twice what free fall reaches from lift height.
                assert np.abs(np.diff(position, axis=0)).max() < 4.0 / SMALL.record_hz

    def test_success_means_held_by_both_pads_ten_centimetres_up_and_through_the_shake(self):
        seen = set()
        for episode in default_episodes(scaled(25, 60)):
            streams = episode.streams
            seen.add(episode.success)
            if not episode.n_steps:
                assert not episode.success
                continue
            com = np.asarray(episode.columns["object_com"])[0]
            up = target_com(streams, com)[:, 2] - episode.columns["rest_height"] >= 0.10
            both = touching(streams).all(axis=1)
            held = np.flatnonzero(streams["phase"] == Phase.HOLD)[-1:]
            shaken = np.flatnonzero(streams["shake_level"] == 1.0)[-1:]
            good = len(held) and len(shaken) and (up & both)[held[0]] and both[shaken[0]]
            assert episode.success == bool(good)
        assert seen == {True, False}

    def test_labels_and_measurements_follow_from_the_stored_streams(self):
        for episode in default_episodes(scaled(25, 60)):
            if Phase.CLOSE not in episode.streams["phase"]:
                continue
            com = np.asarray(episode.columns["object_com"])[0]
            rest = episode.columns["rest_height"]
            assert judge(episode.streams, com, rest, SMALL.label) is episode.outcome
            measured = measure(episode.streams, com, rest)
            for field in dataclasses.fields(measured):
                found = getattr(measured, field.name)
                assert np.array_equal(found, episode.columns[field.name], equal_nan=True)


class TestRecordRate:
    """What is recorded how often must not change what happens."""

    @pytest.mark.parametrize("record_hz", [240, 60, 10])
    def test_the_same_motion_and_outcome_at_any_rate(self, world, record_hz):
        for index in (0, 1, 3, 4):
            usual = default_episodes(6)[index]
            episode = run_episode(world, dataclasses.replace(usual.spec, record_hz=record_hz))
            assert episode.outcome is usual.outcome
            # The IMU runs at its own rate, so it feels whether anything else happened.
            assert np.array_equal(episode.imu["specific_force"], usual.imu["specific_force"])

    def test_a_touch_between_two_records_is_a_collision(self, world, monkeypatch):
        """The fingers come down on the cube; at 10 Hz they would be deep in it at a record."""
        aiming(monkeypatch, grasp_at(0.55, 0.05 + 0.055, 0.03))
        episode = run_episode(world, cube_spec(record_hz=10))
        assert episode.outcome is Outcome.COLLISION
        moved = np.ptp(episode.streams["object_pose"][:, 0, :3], axis=0)
        assert moved.max() < 0.002


def test_a_policy_cannot_alter_what_is_stored(world, monkeypatch):
    def blacken(view, rng, settings):
        view.images["front"].rgb[:] = 0

    policy = Policy("top_down", "vandal", TopDownParameters, blacken)
    monkeypatch.setattr(rollout, "POLICIES", {"top_down": policy})
    with pytest.raises(PolicyError, match="read-only"):
        run_episode(world, cube_spec())


class TestOutcomes:
    def test_a_cube_under_the_gripper_is_lifted_and_held(self, world):
        episode = run_episode(world, cube_spec())
        assert episode.outcome is Outcome.SUCCESS
        assert episode.columns["lift_height"] == pytest.approx(0.2, abs=0.005)
        assert episode.columns["min_grip_force"] == pytest.approx(20.0, rel=0.05)
        assert episode.columns["hold_duration"] == pytest.approx(0.3, abs=0.01)
        assert episode.columns["slip_distance"] < 0.002
        assert episode.streams["reward"].sum() == 1.0

    def test_a_grasp_beside_the_target_makes_no_contact(self, world, monkeypatch):
        aiming(monkeypatch, grasp_at(0.55, -0.12, 0.03))
        episode = run_episode(world, cube_spec())
        assert episode.outcome is Outcome.NO_CONTACT
        assert Phase.HOLD not in episode.streams["phase"]

    def test_fingers_that_come_down_on_the_target_collide_with_it(self, world, monkeypatch):
        aiming(monkeypatch, grasp_at(0.55, 0.05 + 0.055, 0.03))
        episode = run_episode(world, cube_spec())
        assert episode.outcome is Outcome.COLLISION
        assert episode.columns["collision_body"] == Label.TARGET
        assert episode.streams["phase"][-1] == Phase.APPROACH

    def test_fingers_that_come_down_on_the_table_collide_with_it(self, world, monkeypatch):
        aiming(monkeypatch, grasp_at(0.55, -0.12, 0.01))
        episode = run_episode(world, cube_spec())
        assert episode.outcome is Outcome.COLLISION
        assert episode.columns["collision_body"] == Label.TABLE

    def test_a_slippery_object_is_lost_in_the_lift(self, world):
        spec = cube_spec()
        soap = dataclasses.replace(spec.objects[0], lateral_friction=0.02)
        episode = run_episode(world, dataclasses.replace(spec, objects=(soap,)))
        assert episode.outcome is Outcome.LOST_IN_LIFT

    def test_a_grasp_out_of_reach_is_unreachable_and_moves_nothing(self, world, monkeypatch):
        aiming(monkeypatch, grasp_at(2.0, 0.0, 0.05))
        episode = run_episode(world, cube_spec())
        assert episode.outcome is Outcome.UNREACHABLE
        assert episode.n_steps == 0
        assert episode.columns["grasp_position"] == pytest.approx([2.0, 0.0, 0.05])
        frames = episode.cameras["front"]
        assert (frames.rgb[0] == frames.rgb[1]).all()

    def test_the_first_reachable_grasp_of_a_plan_is_executed(self, world, monkeypatch):
        aiming(monkeypatch, grasp_at(2.0, 0.0, 0.05), grasp_at(0.55, 0.05, 0.03))
        episode = run_episode(world, cube_spec())
        assert episode.outcome is Outcome.SUCCESS
        assert episode.columns["grasp_position"] == pytest.approx([0.55, 0.05, 0.03])

    def test_a_target_that_no_camera_sees_gives_no_plan(self, world):
        away = {"front": CameraConfig(eye=(1.0, 0.0, 0.5), target=(2.0, 0.0, 0.0))}
        episode = run_episode(world, cube_spec(cameras=away))
        assert episode.outcome is Outcome.NO_PLAN
        assert np.isnan(episode.columns["grasp_position"]).all()

    def test_an_object_that_rolls_away_has_left_the_workspace(self, world):
        episode = run_episode(world, cube_spec((0.9, 0.0, 0.05)))
        assert episode.outcome is Outcome.LEFT_WORKSPACE
        assert episode.n_steps == 0

    def test_a_file_that_cannot_be_loaded_is_a_recipe_error(self, world, monkeypatch):
        monkeypatch.setattr("grasp_factory.simulation.scene.DATA", Path("/nowhere"))
        with pytest.raises(RecipeError, match="cannot be loaded"):
            run_episode(world, cube_spec())


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_robot_lifts_the_cube_and_the_attempt_fits_its_bound(world, robot):
    episode = run_episode(world, cube_spec(robot=robot))
    assert episode.success
    assert episode.n_steps <= SMALL.longest_attempt


def test_the_pad_named_left_is_the_one_on_the_tcps_positive_y_side(world):
    episode = run_episode(world, cube_spec())
    normals = episode.streams["tactile_normal"][-1, :, 0]
    assert normals[0] == pytest.approx([0, 1, 0], abs=0.05)
    assert normals[1] == pytest.approx([0, -1, 0], abs=0.05)
