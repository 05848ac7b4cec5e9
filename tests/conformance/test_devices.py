"""What every device of the table must do, against its simulator over the real transport."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from support.devices import (
    DeviceRun,
    eventually,
    played,
    running,
    simulator,
    values,
)

from grasp_factory.capture.devices import DEVICES
from grasp_factory.capture.devices.base import DeviceModel, class_at
from grasp_factory.capture.devices.robotiq_ft300 import STREAM_STARTED
from grasp_factory.capture.samples import DeviceKind, Sample
from grasp_factory.capture.simulators.base import SimulatedDevice
from grasp_factory.capture.simulators.faults import Faults
from grasp_factory.errors import CaptureError, ConfigError

PAYLOADS = {
    DeviceKind.CAMERA: "CameraFrame",
    DeviceKind.IMU: "InertialReading",
    DeviceKind.FORCE_TORQUE: "WrenchReading",
    DeviceKind.TACTILE: "TactileReading",
    DeviceKind.JOINTS: "JointReading",
}
SPEED = 8.0
"""How much faster than the attempt simulators play here."""
SPEEDS = {"realsense": 1.0}
"""librealsense drops frames when 16 wait: at a speed of 8 a pause of 70 ms is enough."""
HOSTILE = (
    None, True, -1, 0, 2**70, -(10**30), 1e308, math.nan, math.inf, "", " ", "\0", "a" * 10_000,
    "/nowhere/\x1b[2J", "..", [], [[]], {}, {"a": 1}, [1] * 100_000, object,
)  # fmt: skip

SIMULATED = {name: model for name, model in DEVICES.items() if model.simulator}
"""Those of ROS 2 are tested with a publisher: tests/capture/ros2/test_drivers.py."""

every_device = pytest.mark.parametrize("model", SIMULATED.values(), ids=SIMULATED)


@pytest.fixture(scope="module")
def runs() -> dict[str, tuple[SimulatedDevice[Any], DeviceRun]]:
    return {}


@pytest.fixture
def whole(
    model: DeviceModel, runs: dict[str, tuple[SimulatedDevice[Any], DeviceRun]]
) -> tuple[SimulatedDevice[Any], DeviceRun]:
    """Return a simulator that has played its track once, and what the driver yielded."""
    if model.name not in runs:
        simulated = simulator(model, speed=SPEEDS.get(model.name, SPEED))
        runs[model.name] = simulated, played(model, simulated)
    return runs[model.name]


def assert_equal_within(sample: Sample[Any], payload: Any, simulated: SimulatedDevice[Any]) -> None:
    expected, got = values(payload), values(sample.payload)
    assert set(got) <= set(expected)
    for name, value in got.items():
        np.testing.assert_allclose(
            value, expected[name], rtol=0, atol=simulated.resolution + 1e-9, equal_nan=True
        )


@every_device
class TestDevice:
    @pytest.mark.soak
    def test_every_sample_arrives_once_and_in_order_with_the_episodes_values(
        self, model: DeviceModel, whole: tuple[SimulatedDevice[Any], DeviceRun]
    ) -> None:
        simulated, run = whole
        assert run.error is None
        assert len(simulated.sent) == len(simulated.track.payloads)
        assert len(run.samples) == len(simulated.sent)
        for place, sample in zip(simulated.sent, run.samples, strict=True):
            assert_equal_within(sample, simulated.track.payloads[place], simulated)

    def test_nothing_is_counted_as_lost_or_bad(
        self, model: DeviceModel, whole: tuple[SimulatedDevice[Any], DeviceRun]
    ) -> None:
        counters = dataclasses.asdict(whole[1].device.counters)
        assert counters.pop("samples") == len(whole[1].samples)
        assert set(counters.values()) == {0}

    def test_its_payload_is_that_of_its_kind(
        self, model: DeviceModel, whole: tuple[SimulatedDevice[Any], DeviceRun]
    ) -> None:
        kinds = {type(sample.payload).__name__ for sample in whole[1].samples}
        assert kinds == {PAYLOADS[model.kind]}

    def test_host_times_ascend_and_are_of_the_monotonic_clock(
        self, model: DeviceModel, whole: tuple[SimulatedDevice[Any], DeviceRun]
    ) -> None:
        times = np.array([sample.host_ns for sample in whole[1].samples])
        assert (np.diff(times) >= 0).all()
        assert 0 < time.monotonic_ns() - times[-1] < 600e9

    def test_its_own_clock_and_count_if_it_has_them_go_as_the_track_does(
        self, model: DeviceModel, whole: tuple[SimulatedDevice[Any], DeviceRun]
    ) -> None:
        simulated, run = whole
        if run.samples[0].sequence is not None:
            numbers = np.array([sample.sequence for sample in run.samples])
            assert (np.diff(numbers) == 1).all()
        if run.samples[0].device_ns is not None:
            ours = np.array([sample.device_ns for sample in run.samples]) * 1e-9
            theirs = simulated.track.times[simulated.sent]
            np.testing.assert_allclose(np.diff(ours), np.diff(theirs), atol=1.1e-3)
            assert (np.diff(ours) > 0).all()

    def test_a_device_that_is_not_there_is_an_error_in_one_line(self, model: DeviceModel) -> None:
        simulated = simulator(model)
        device = model.make(simulated.settings)
        if model.name != "joints":  # it listens, and cannot know
            with pytest.raises(CaptureError) as refused:
                device.open()
            assert "\n" not in str(refused.value)
        device.close()
        device.close()

    def test_a_second_recording_begins_where_the_first_one_ended(self, model: DeviceModel) -> None:
        repeats = 50 if class_at(model.simulator).is_live else 1
        with running(model, simulator(model, speed=SPEED, repeats=repeats)) as run:
            eventually(lambda: len(run.samples) > 3)
            run.stop()
            run.device.close()
            run.device.open()
            again = DeviceRun(run.device, run.simulated)
            again.start()
            eventually(lambda: len(again.samples) > 3)
            again.stop()
            assert run.device.counters.samples == len(again.samples)

    def test_it_stops_within_a_fifth_of_a_second(self, model: DeviceModel) -> None:
        taken = []
        for _ in range(3):
            with running(model, simulator(model)) as run:
                eventually(lambda run=run: len(run.samples) > 1)  # type: ignore[misc]
                taken.append(run.stop())
        assert min(taken) < 0.2

    def test_unknown_settings_and_wrong_types_are_refused(self, model: DeviceModel) -> None:
        good = dict(simulator(model).settings)
        with pytest.raises(ConfigError, match="unknown key"):
            model.make({**good, "spped": 1})
        for field in dataclasses.fields(model.settings):
            for value in (object, [[[]]], {"a": {}}):
                with pytest.raises(ConfigError):
                    model.make({**good, field.name: value})

    def test_hostile_settings_are_refused_or_fail_to_open_in_one_line(
        self, model: DeviceModel
    ) -> None:
        good = dict(simulator(model).settings)
        for field in dataclasses.fields(model.settings):
            for value in HOSTILE:
                try:
                    device = model.make({**good, field.name: value})
                    device.close()
                except ConfigError as refused:
                    assert "\n" not in str(refused)
                    assert len(str(refused)) < 1000

    def test_its_classes_are_where_its_row_says(self, model: DeviceModel) -> None:
        assert callable(class_at(model.implementation))
        assert issubclass(class_at(model.simulator), SimulatedDevice)
        assert dataclasses.is_dataclass(model.settings)


LIVE = [model for model in SIMULATED.values() if class_at(model.simulator).is_live]
live_device = pytest.mark.parametrize("model", LIVE, ids=lambda model: model.name)


@live_device
class TestLiveDevice:
    def test_it_comes_back_after_it_was_unplugged(self, model: DeviceModel) -> None:
        with running(model, simulator(model, repeats=50)) as run:
            simulated = run.simulated
            eventually(lambda: len(run.samples) > 3)
            simulated.unplug()
            time.sleep(0.7)
            before = len(run.samples)
            simulated.plug()
            eventually(lambda: len(run.samples) > before + 3)
            assert run.error is None
            assert run.device.counters.reconnects == 1
            numbers = [s.sequence for s in run.samples if s.sequence is not None]
            assert sorted(set(numbers)) == numbers
            assert_known(run, simulated)

    def test_it_fails_if_it_does_not_come_back(self, model: DeviceModel) -> None:
        with running(model, simulator(model, repeats=50), reconnect_s=0.1) as run:
            eventually(lambda: len(run.samples) > 3)
            run.simulated.unplug()
            run.wait()
            assert isinstance(run.error, CaptureError)
            assert "0.1 s" in str(run.error)

    def test_batches_lose_nothing(self, model: DeviceModel) -> None:
        faults = Faults(batch_s=0.016)
        simulated = simulator(model, speed=SPEED, faults=faults)
        run = played(model, simulated)
        assert len(run.samples) == len(simulated.track.payloads)


def test_a_sensor_that_begins_late_after_its_answer_sends_its_first_sample_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model = DEVICES["robotiq_ft300"]
    simulated = simulator(model, speed=SPEED, faults=Faults(batch_s=0.016))
    line = simulated._line
    write = line.write

    def write_and_pause(data: bytes, is_left: Callable[[], bool]) -> bool:
        is_sent: bool = write(data, is_left)
        if data == STREAM_STARTED:
            time.sleep(0.2)
        return is_sent

    monkeypatch.setattr(line, "write", write_and_pause)
    assert len(played(model, simulated).samples) == len(simulated.track.payloads)


def assert_known(run: DeviceRun, simulated: SimulatedDevice[Any]) -> None:
    """Check that each sample is one of the track's, so that none was made up of two."""
    known = np.array([flat(payload) for payload in simulated.track.payloads])
    for sample in [*run.samples]:  # the device goes on
        nearest = np.abs(known - flat(sample.payload)).max(axis=1).min()
        assert nearest <= simulated.resolution + 1e-9


def flat(payload: Any) -> np.ndarray[Any, Any]:
    return np.concatenate([value.ravel() for value in values(payload).values()])


COUNTED = ("ati_net_ft", "onrobot", "tactile_array", "joints")
"""Devices that count their samples."""


@pytest.mark.parametrize("name", COUNTED)
class TestCounts:
    def test_lost_samples_are_counted_exactly(self, name: str) -> None:
        model = DEVICES[name]
        simulated = simulator(model, speed=SPEED, faults=Faults(lost=0.1, seed=2))
        run = played(model, simulated)
        numbers = [sample.sequence for sample in run.samples]
        assert numbers == simulated.sent
        between = numbers[-1] - numbers[0] + 1 - len(numbers)
        assert run.device.counters.lost == between > 10

    def test_a_count_that_wraps_goes_on(self, name: str) -> None:
        model = DEVICES[name]
        start = 2**32 - 20
        simulated = simulator(model, speed=SPEED, faults=Faults(counter_start=start))
        run = played(model, simulated)
        numbers = [sample.sequence for sample in run.samples]
        assert numbers == list(range(start, start + len(simulated.sent)))
        assert run.device.counters.lost == 0


@pytest.mark.parametrize("name", ["bmi088", "robotiq_ft300", "tactile_array"])
def test_packet_faults_on_the_line_cost_no_clean_packet(name: str) -> None:
    model = DEVICES[name]
    faults = Faults(dropped_bytes=0.02, bad_checksums=0.02, garbage=0.01, seed=3)
    simulated = simulator(model, speed=SPEED, faults=faults)
    run = played(model, simulated)
    assert len(simulated.sent) < len(simulated.track.payloads)
    assert len(run.samples) == len(simulated.sent)
    for place, sample in zip(simulated.sent, run.samples, strict=True):
        assert_equal_within(sample, simulated.track.payloads[place], simulated)
    assert run.device.counters.bad_checksums > 0
    assert run.device.counters.skipped_bytes > 0
