"""The calibration of an inertial sensor: from recordings to a folder of files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from grasp_factory.capture.calibration.allan import AllanCurve, NoiseFigures, allan_curve
from grasp_factory.capture.calibration.imu_model_file import ImuModel, write_imu_model
from grasp_factory.capture.calibration.kalibr import KalibrImu, write_imu
from grasp_factory.capture.calibration.series_source import RecordedSeries, read_series
from grasp_factory.capture.calibration.still_positions import still_positions
from grasp_factory.core.geometry import Array
from grasp_factory.core.optional import require
from grasp_factory.core.output_folder import check_free, publish
from grasp_factory.core.scratch_folder import scratch_folder
from grasp_factory.errors import CaptureError, StoreError
from grasp_factory.signals.imu_calibration import (
    LOCAL_GRAVITY,
    PositionFit,
    TriadModel,
    calibrate_by_gravity,
    calibrate_six_positions,
    static_bias,
    with_temperature,
)

_MOST_STILL_STD = 1.0
"""m/s2: a sensor at rest varies less."""
NOISE_FILE, MODEL_FILE, PLOT_FILE = "imu.yaml", "imu_model.yaml", "allan.png"


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuSources:
    """The recordings of a calibration."""

    still: Path
    """At rest: noise, bias, temperature."""
    positions: Path | None = None
    """Still positions one after the other: scale and axes."""
    topic: str = ""
    aligned: bool = False
    """Whether each position is along an axis: the sensor sits in a square block."""
    gravity: float = LOCAL_GRAVITY
    """m/s2 at the place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuCalibration:
    """What a calibration of an inertial sensor found."""

    rate_hz: float
    duration_s: float
    accelerometer: tuple[NoiseFigures, ...]
    """Of x, y and z; u is m/s2."""
    gyroscope: tuple[NoiseFigures, ...]
    """u is rad/s."""
    noise: KalibrImu
    model: ImuModel
    position_fit: PositionFit | None
    has_temperature: bool
    curves: tuple[AllanCurve, AllanCurve]
    """Of accelerometer and gyroscope."""


def calibrate_imu(sources: ImuSources) -> ImuCalibration:
    """Return noise, bias and, if positions are given, scale and axes of an inertial sensor.

    Raises:
        UsageError: if a recording cannot be opened, or lacks positions.
        CaptureError: if a recording is damaged, too short, or not at rest.
        MissingLibraryError: if a library is not installed.
    """
    require("allantools", "scipy", extra="calibration")
    still = read_series(sources.still, "imu", sources.topic)
    force, speed = still.values[:, :3], still.values[:, 3:]
    if force.std(axis=0).max() > _MOST_STILL_STD:
        std = force.std(axis=0).max()
        raise CaptureError(
            f"{sources.still}: the sensor moves: specific force varies by {std:.3g} m/s2, valid:"
            f" up to {_MOST_STILL_STD:g}; lay it still"
        )
    force_curve, force_noise = allan_curve(force, still.rate_hz)
    speed_curve, speed_noise = allan_curve(speed, still.rate_hz)
    fit = _positions(sources)
    model, has_temperature = _model(still, fit)
    return ImuCalibration(
        rate_hz=still.rate_hz,
        duration_s=float(still.times[-1] - still.times[0]),
        accelerometer=force_noise,
        gyroscope=speed_noise,
        noise=KalibrImu(
            accelerometer_noise_density=_worst([axis.density for axis in force_noise]),
            accelerometer_random_walk=_worst([axis.random_walk for axis in force_noise]),
            gyroscope_noise_density=_worst([axis.density for axis in speed_noise]),
            gyroscope_random_walk=_worst([axis.random_walk for axis in speed_noise]),
            update_rate=round(still.rate_hz, 3),
            rostopic=sources.topic,
        ),
        model=model,
        position_fit=fit,
        has_temperature=has_temperature,
        curves=(force_curve, speed_curve),
    )


def write_imu_calibration(found: ImuCalibration, out: Path) -> None:
    """Write a new folder with the noise (kalibr's form), the model, and the plot.

    Raises:
        UsageError: if the name is taken, or its parent does not exist.
        StoreError: if it cannot be written.
        MissingLibraryError: if matplotlib is not installed.
    """
    from grasp_factory.capture.calibration.allan_plot import draw_allan  # noqa: PLC0415

    check_free(out, "a calibration")
    try:
        with scratch_folder(out.parent, "grasp-factory-calibration") as scratch:
            built = scratch / "out"
            built.mkdir()
            write_imu(built / NOISE_FILE, found.noise)
            write_imu_model(built / MODEL_FILE, found.model)
            (built / PLOT_FILE).write_bytes(draw_allan(found))
            publish(built, out, "a calibration")
    except OSError as error:
        raise StoreError(f"{out} cannot be written: {error.strerror or error}") from None


def _positions(sources: ImuSources) -> PositionFit | None:
    if sources.positions is None:
        return None
    series = read_series(sources.positions, "imu", sources.topic)
    means = still_positions(series.values[:, :3], series.rate_hz)
    fit = calibrate_six_positions if sources.aligned else calibrate_by_gravity
    return fit(means, sources.gravity)


def _model(still: RecordedSeries, fit: PositionFit | None) -> tuple[ImuModel, bool]:
    """Return the model, and whether the recording shows the influence of temperature."""
    force, speed, warm = still.values[:, :3], still.values[:, 3:], still.extra
    accelerometer = fit.model if fit else TriadModel()
    gyroscope = TriadModel(bias=static_bias(speed))
    warm_force = with_temperature(accelerometer, force, warm)
    warm_speed = with_temperature(gyroscope, speed, warm)
    if warm_force is None or warm_speed is None:
        reference = float(np.nanmean(warm)) if np.isfinite(warm).any() else 25.0
        plain = (replace(t, reference_temperature=reference) for t in (accelerometer, gyroscope))
        return ImuModel(**dict(zip(("accelerometer", "gyroscope"), plain, strict=True))), False
    return ImuModel(accelerometer=warm_force, gyroscope=warm_speed), True


def _worst(values: list[float] | Array) -> float:
    """Return the largest: kalibr takes one figure for three axes, and too low ones hurt it."""
    return float(np.max(values))
