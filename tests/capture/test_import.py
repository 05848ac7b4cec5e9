"""A session becomes a store: its values and times are those that were recorded, and no others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.grasp_sessions import (
    SECONDS,
    SIZE,
    event,
    force_at,
    recorded_grasps,
    session,
    width_at,
)
from support.sessions import JOINTS, START, WRENCH, Channel, Recorded

from grasp_factory.capture.importing.cuts import parsed_cuts, read_cuts
from grasp_factory.capture.importing.gripper_motion import closings
from grasp_factory.capture.importing.import_settings import ImportSettings
from grasp_factory.capture.importing.importing_store import import_session
from grasp_factory.capture.importing.outcome_labels import RealLabels
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import Outcome
from grasp_factory.core.serialization import from_plain
from grasp_factory.curation.merge import merge
from grasp_factory.curation.replay import replay_import
from grasp_factory.curation.verify import verify
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import CaptureError, UsageError

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return session(tmp_path_factory.mktemp("recorded") / "ses")


@pytest.fixture(scope="module")
def store(recorded: Path) -> Path:
    out = recorded.parent / "real.zarr"
    import_session(recorded, out, ImportSettings())
    return out


def test_own_rates_keep_every_value_and_times_within_a_millisecond(store: Path) -> None:
    episode = Dataset(store)[0]
    force = episode.own_rate["force_torque"]
    assert np.allclose(
        force["timestamp"], 1e-9 + np.arange(len(force["timestamp"])) / 500.0, atol=1e-6
    )
    assert np.allclose(force["wrench"][:, 2], force_at(1.0 + np.arange(1951) / 500.0), rtol=1e-12)
    imu = episode.imu["timestamp"]
    assert np.abs(np.diff(imu) - 1 / 200.0).max() < 1e-3
    assert np.abs(imu - np.round(imu * 200.0) / 200.0).max() < 1e-3
    joints = episode.own_rate["joints"]
    expected = width_at(1.0 + joints["timestamp"])
    assert np.allclose(joints["gripper_width"], expected, atol=1e-9)


def test_streams_are_on_the_record_timeline_and_interpolated(store: Path) -> None:
    dataset = Dataset(store)
    streams, rate = dataset[0].streams, dataset.config.record_hz
    assert np.array_equal(streams["timestamp"], np.arange(1, len(streams["timestamp"]) + 1) / rate)
    at = 1.0 + streams["timestamp"]
    assert np.allclose(streams["gripper_width"], width_at(at), atol=2e-3)
    assert np.allclose(streams["joint_positions"][:, 0], 0.1 * at, atol=1e-5)
    assert np.allclose(streams["wrist_wrench"][:, 2], force_at(at), atol=0.03)


def test_what_was_not_measured_is_empty(store: Path) -> None:
    dataset = Dataset(store)
    episode = dataset[0]
    assert np.isnan(episode.streams["object_pose"]).all()
    assert np.isnan(episode.streams["tactile_force"]).all()
    assert (episode.streams["tactile_body"] == 255).all()
    assert (episode.streams["phase"] == 255).all()
    frames = episode.cameras["front"]
    assert (frames.segmentation == 255).all()
    assert np.isnan(frames.T_world_camera).all()
    assert np.isnan(dataset.value(0, "object_mass"))
    assert episode.spec.objects[0].mass is None


def test_images_before_and_after_are_the_nearest_in_time(store: Path) -> None:
    depth = Dataset(store)[0].cameras["front"].depth
    assert depth[0, 1, 1] == np.float32(0.710)
    assert depth[1, 1, 1] == np.float32(0.749)


def test_each_witness_has_its_column_and_all_call_it_a_success(store: Path) -> None:
    dataset = Dataset(store)
    told = [int(dataset.value(0, f"label_{who}")) for who in ("operator", "gripper", "force")]
    assert told == [255, Outcome.SUCCESS, Outcome.SUCCESS]
    assert dataset[0].outcome is Outcome.SUCCESS
    assert dataset.value(0, "object_id") == "real/cup"


def test_verify_finds_nothing_and_replay_gives_the_same_bytes(store: Path, recorded: Path) -> None:
    assert verify(store).problems == ()
    found = replay_import(store, 0, recorded)
    assert found.same, found.difference


def test_another_session_is_refused(store: Path, tmp_path: Path) -> None:
    other = session(tmp_path / "ses", label="success")
    with pytest.raises(CaptureError, match=r"is not what episode 0 was imported from: SHA-256"):
        replay_import(store, 0, other)


def test_what_the_operator_says_counts_first(tmp_path: Path) -> None:
    out = tmp_path / "real.zarr"
    import_session(session(tmp_path / "ses", label="unstable"), out, ImportSettings())
    dataset = Dataset(out)
    assert dataset[0].outcome is Outcome.UNSTABLE
    assert int(dataset.value(0, "label_gripper")) == Outcome.SUCCESS
    assert verify(out).problems == ()


def test_the_gripper_cuts_from_before_it_closes_until_after_it_opens(tmp_path: Path) -> None:
    recorded, out = session(tmp_path / "ses", marks=False), tmp_path / "real.zarr"
    made = import_session(recorded, out, from_plain(ImportSettings, {"cut": "gripper"}))
    (row,) = made.rows
    assert row.start_s == pytest.approx(0.0, abs=0.1)
    assert row.start_s + row.duration_s == pytest.approx(5.5, abs=0.1)
    assert replay_import(out, 0, recorded).same


def test_a_list_cuts_and_labels(recorded: Path, tmp_path: Path) -> None:
    file = tmp_path / "cuts.csv"
    file.write_text("\ufeffstart,end,outcome\n0.5,1.5,no_contact\n2.0,3.0,success\n3.5,4.5,\n")
    settings = from_plain(ImportSettings, {"cut": "list"})
    made = import_session(recorded, tmp_path / "r.zarr", settings, listed=read_cuts(file))
    assert [row.outcome for row in made.rows] == ["no_contact", "success", "quarantined"]
    assert "no label" in made.rows[2].reason
    assert verify(tmp_path / "r.zarr").problems == ()


@pytest.mark.parametrize("text", ["start,stop\n", "start,end\n2,1\n", "start,end\nx,1\n",
                                  "start,end,outcome\n1,2,good\n",
                                  "start,end,outcome\n1,2,,x\n",
                                  "start,end\n1,1.0000000001\n"])  # fmt: skip
def test_a_wrong_list_is_one_line(text: str, tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_text(text)
    with pytest.raises(UsageError, match=r"--cuts .*c\.csv: line \d: got .*, valid: "):
        read_cuts(tmp_path / "c.csv")


def test_a_list_that_is_no_csv_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_text("start,end\n" + "0" * 200_000)
    with pytest.raises(UsageError, match=r"--cuts .*c\.csv(: line 2: got| cannot be read: field)"):
        read_cuts(tmp_path / "c.csv")


@pytest.mark.parametrize(("start", "end"), [(50.0, 60.0), (2.0, 100.0)])
def test_an_episode_outside_of_the_session_is_refused(
    start: float, end: float, recorded: Path, tmp_path: Path
) -> None:
    listed = parsed_cuts(f"start,end\n{start},{end}\n", "c.csv")
    settings = from_plain(ImportSettings, {"cut": "list"})
    with pytest.raises(CaptureError, match=r"is not inside of the session, which is 5\.998 s long"):
        import_session(recorded, tmp_path / "r.zarr", settings, listed=listed)
    assert not (tmp_path / "r.zarr").exists()


@pytest.mark.parametrize(
    ("key", "value"),
    [("latency_s", 0.01), ("cameras", "front"), ("T_world_camera", np.eye(4).tolist())],
)
def test_a_setting_of_a_name_that_is_not_there_is_refused(
    key: str, value: Any, recorded: Path, tmp_path: Path
) -> None:
    settings = from_plain(ImportSettings, {key: {"frunt": value}})
    with pytest.raises(UsageError, match=rf"unknown .* in {key} 'frunt'; did you mean 'front'"):
        import_session(recorded, tmp_path / "r.zarr", settings)


def test_commands_of_one_arm_are_never_those_of_another(tmp_path: Path) -> None:
    made = recorded_grasps(SECONDS, width_at)
    event(made, "episode_start", 1.0)
    event(made, "episode_end", 4.9, success=True)
    topic = Channel(topic="/b/joint_commands", kind=JOINTS, device="b", device_kind="joints")
    fields = {"name": ["joint_1"], "position": np.array([9.0])}
    made.messages += [
        Recorded(channel=topic, log_ns=START + k * 10**7, fields=fields) for k in range(600)
    ]
    import_session(made.write(tmp_path / "ses"), tmp_path / "r.zarr", ImportSettings())
    streams = Dataset(tmp_path / "r.zarr")[0].streams
    assert np.isnan(streams["joint_position_targets"]).all()
    assert np.isfinite(streams["joint_positions"]).all()


def test_a_gripper_that_is_read_less_often_than_the_arm_is_interpolated(tmp_path: Path) -> None:
    made = recorded_grasps(SECONDS, width_at)
    event(made, "episode_start", 1.0)
    event(made, "episode_end", 4.9, success=True)
    arm = [m for m in made.messages if m.channel.kind == JOINTS]
    made.messages = [m for m in made.messages if m.channel.kind != JOINTS]
    for k, message in enumerate(arm):
        less = {name: values[:-1] for name, values in message.fields.items()}
        made.messages.append(replace(message, fields=less) if k % 2 else message)
    import_session(made.write(tmp_path / "ses"), tmp_path / "r.zarr", ImportSettings())
    episode = Dataset(tmp_path / "r.zarr")[0]
    assert np.isnan(episode.own_rate["joints"]["gripper_width"]).mean() == pytest.approx(
        0.5, abs=0.01
    )
    at = 1.0 + episode.streams["timestamp"]
    assert np.allclose(episode.streams["gripper_width"], width_at(at), atol=2e-3)
    assert np.isfinite(episode.streams["joint_positions"]).all()


def test_an_event_whose_text_is_no_unicode_is_one_line(tmp_path: Path) -> None:
    made = recorded_grasps(1.0, width_at)
    event(made, "episode_start", 0.1, object="\ud800")
    with pytest.raises(CaptureError, match="an event is no JSON with a name"):
        import_session(made.write(tmp_path / "ses"), tmp_path / "r.zarr", ImportSettings())


def test_infinity_is_no_measurement(tmp_path: Path) -> None:
    made = recorded_grasps(SECONDS, width_at)
    event(made, "episode_start", 1.0)
    event(made, "episode_end", 4.9, success=True)
    bad = np.array([[1.0, np.inf, 1e300, 4.0, 5.0, 6.0]])
    made.messages = [m for m in made.messages if m.channel.kind != WRENCH]
    made.wrench(np.repeat(bad, 3000, axis=0), 500.0).taxels(np.full((2, 2), np.inf, np.float32))
    made.messages[-1] = replace(made.messages[-1], log_ns=START + 2 * 10**9)
    import_session(made.write(tmp_path / "ses"), tmp_path / "r.zarr", ImportSettings())
    episode = Dataset(tmp_path / "r.zarr")[0]
    expected = [1.0, np.nan, np.nan, 4.0, 5.0, 6.0]
    assert np.array_equal(episode.own_rate["force_torque"]["wrench"][0], expected, equal_nan=True)
    assert np.isnan(episode.own_rate["taxels"]["pressure"]).all()
    assert verify(tmp_path / "r.zarr").problems == ()


def test_too_low_a_quality_is_quarantined_with_the_reason(recorded: Path, tmp_path: Path) -> None:
    strict = from_plain(ImportSettings, {"quality": {"min_score": 5, "min_exposure": 0.9}})
    made = import_session(recorded, tmp_path / "r.zarr", strict)
    assert made.committed == 0
    assert "is below min_score 5: " in made.rows[0].reason
    assert "min_exposure" in made.rows[0].reason


def test_a_store_that_exists_is_left_alone(store: Path, recorded: Path) -> None:
    with pytest.raises(UsageError, match="only new stores are made"):
        import_session(recorded, store, ImportSettings())


def test_what_the_session_says_can_be_queried(store: Path, run: Run) -> None:
    code, out, _ = run("query", str(store), "--where", "operator=op1", "--where", "source=real",
                       "--where", "weather=rain", "--where", "task=pick", "--json")  # fmt: skip
    assert code == 0, out
    assert "real/cup" in out


def test_it_merges_with_simulated_stores(
    recorded: Path, tmp_path: Path, simulated_like: Path
) -> None:
    real, both = tmp_path / "real.zarr", tmp_path / "both.zarr"
    base = Dataset(simulated_like).config
    import_session(recorded, real, ImportSettings(), base=base)
    merge([simulated_like, real], both)
    dataset = Dataset(both)
    assert dataset.column("source").tolist() == [0, 0, 1]
    assert len(dataset[0].own_rate["force_torque"]["timestamp"]) == 0
    assert len(dataset[2].own_rate["force_torque"]["timestamp"]) == 1951
    assert verify(both).problems == ()
    assert replay_import(both, 2, recorded).same


@pytest.fixture(scope="module")
def simulated_like(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from grasp_factory.factory.generate import generate

    out = tmp_path_factory.mktemp("simulated") / "sim.zarr"
    plain = {"resolution": [SIZE[1], SIZE[0]], "block_size": 2, "policies": {"top_down": 1.0}}
    generate(FactoryConfig.from_plain(plain), 2, out, workers=1)
    return out


codes = st.none() | st.sampled_from(list(Outcome))


@given(operator=codes, gripper=codes, force=codes)
def test_a_success_needs_everybody_who_says_something(
    operator: Outcome | None, gripper: Outcome | None, force: Outcome | None
) -> None:
    outcome = RealLabels(operator=operator, gripper=gripper, force=force).outcome
    told = [label for label in (gripper, force) if label is not None]
    if operator is not None:
        assert outcome is operator
    elif not told:
        assert outcome is None
    else:
        assert (outcome is Outcome.SUCCESS) == all(label is Outcome.SUCCESS for label in told)


@given(noise=st.integers(0, 2**31), amount=st.floats(0.0, 0.0005))
def test_closings_are_found_in_noise(noise: int, amount: float) -> None:
    seconds = np.arange(0.0, SECONDS, 0.01)
    width = width_at(seconds) + np.random.default_rng(noise).normal(0.0, amount, len(seconds))
    (found,) = closings(np.round(seconds * 1e9).astype(np.int64), width, 0.01)
    assert found.begins_ns == pytest.approx(2.0e9, abs=0.1e9)
    assert found.closed_ns == pytest.approx(2.5e9, abs=0.1e9)
    assert found.opens_ns == pytest.approx(5.0e9, abs=0.1e9)
