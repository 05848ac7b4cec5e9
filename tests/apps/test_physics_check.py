"""check-physics: passes on this machine, and fails on data that is wrong."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from support.scenes import default_episodes

from grasp_factory.apps.physics_check import (
    SHORT,
    check_physics,
    coulomb,
    held_object,
    inertial,
    label_convergence,
)
from grasp_factory.apps.physics_check.figure import Figure, at_most, percentiles
from grasp_factory.cli.check_physics import figures_text
from grasp_factory.core.enums import Outcome
from grasp_factory.simulation.world import World

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def successes():
    return [episode for episode in default_episodes(12) if episode.success]


def scaled(episode, stream, factor):
    streams = dict(episode.streams)
    streams[stream] = streams[stream] * np.float32(factor)
    return dataclasses.replace(episode, streams=streams)


def by_check(figures):
    return {(f.check.split(":")[-1].strip(), f.figure): f.passes for f in figures}


def test_at_rest_everything_agrees_with_newton(successes):
    figures = held_object.at_rest(successes)
    assert len(figures) == 4
    assert all(figure.passes for figure in figures), figures_text(figures)


def test_pads_that_read_two_percent_too_much_are_found(successes):
    wrong = [scaled(episode, "tactile_force", 1.02) for episode in successes]
    found = by_check(held_object.at_rest(wrong))
    assert not found["pads' force against weight", "median"]
    assert found["wrist less tool weight against weight", "median"]


def test_a_wrist_that_reads_one_percent_too_much_is_found(successes):
    wrong = [scaled(episode, "wrist_wrench", 1.01) for episode in successes]
    found = by_check(held_object.at_rest(wrong))
    assert not found["wrist less tool weight against weight", "median"]
    assert found["pads' force against weight", "median"]


def test_contact_points_a_millimetre_off_are_found(successes):
    wrong = []
    for episode in successes:
        streams = dict(episode.streams)
        streams["tactile_position"] = streams["tactile_position"] + np.float32(0.001)
        wrong.append(dataclasses.replace(episode, streams=streams))
    found = by_check(held_object.at_rest(wrong))
    assert not found["pads' moment about the COM, of weight x 1 cm", "median"]


def test_an_imu_half_a_percent_off_is_found(successes):
    assert all(figure.passes for figure in inertial.at_rest(successes))
    wrong = []
    for episode in successes:
        imu = dict(episode.imu)
        imu["specific_force"] = imu["specific_force"] * np.float32(1.005)
        wrong.append(dataclasses.replace(episode, own_rate={"imu": imu}))
    assert not any(figure.passes for figure in inertial.at_rest(wrong))


def test_the_imus_noise_has_the_densities_of_its_model(monkeypatch):
    figures = inertial.noise_model()
    assert all(figure.passes for figure in figures), figures_text(figures)
    gyroscope = dataclasses.replace(inertial.BMI088.gyroscope, noise_density=(2e-4,) * 3)
    louder = dataclasses.replace(inertial.BMI088, gyroscope=gyroscope)
    reading = inertial.apply_imu_noise
    monkeypatch.setattr(
        inertial, "apply_imu_noise", lambda noise, *a, **k: reading(louder, *a, **k)
    )
    assert [figure.passes for figure in inertial.noise_model()] == [True, False]


def test_overlaps_beyond_a_millimetre_are_found(successes):
    assert all(figure.passes for figure in label_convergence.overlaps(successes))
    for column in ("max_penetration", "table_penetration"):
        columns = dict(successes[0].columns) | {column: 0.0011}
        wrong = dataclasses.replace(successes[0], columns=columns)
        assert not all(
            figure.passes for figure in label_convergence.overlaps([*successes, wrong] * 1)[:2]
        )


def test_labels_that_finer_steps_do_not_confirm_are_counted(successes):
    with World() as world:
        right = label_convergence.against_finer_steps(world, successes[:1])
        assert [f.passes for f in right] == [True, True, True]
        flipped = dataclasses.replace(successes[0], outcome=Outcome.LOST_IN_LIFT)
        wrong = label_convergence.against_finer_steps(world, [flipped])
        assert [f.passes for f in wrong[:2]] == [False, False]


@pytest.mark.soak
def test_the_holding_threshold_is_coulombs(capsys):
    with World() as world:
        (figure,) = coulomb.threshold(world)
    assert figure.passes, figure
    assert figure.value > 0.0


def test_a_figure_without_samples_does_not_pass():
    assert not at_most("x", "y", 0.0, 1.0, samples=0).passes
    assert [f.passes for f in percentiles("x", [], {50: 1.0})] == [False]


def test_bounds_are_said_in_words():
    assert at_most("x", "y", 0.5, 1.0, unit="mm").bound == "<= 1 mm"
    both = Figure(check="x", figure="y", value=1.0, unit="%", low=20.0, high=45.0, samples=1)
    assert both.bound == "20 to 45 %"
    assert not both.passes


@pytest.mark.soak
def test_the_short_check_passes_on_this_machine():
    figures = list(check_physics(SHORT))
    assert len(figures) == 11
    assert all(figure.passes for figure in figures), figures_text(figures)
