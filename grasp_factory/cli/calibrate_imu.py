"""The command that calibrates an inertial sensor: ``calibrate imu``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from grasp_factory.cli.params import AS_JSON, Command, option
from grasp_factory.cli.printing import print_json, say_lines
from grasp_factory.core.optional import require

if TYPE_CHECKING:
    from collections.abc import Iterator

    from grasp_factory.capture.calibration.imu_calibrating import ImuCalibration


@click.command(
    cls=Command,
    name="imu",
    examples=(
        "grasp-factory calibrate imu still.csv imu_calibration",
        "grasp-factory calibrate imu session_1 out --topic /imu --positions turned.csv",
    ),
)
@click.argument("still", metavar="STILL", type=click.Path(path_type=Path))
@click.argument("out", metavar="OUT", type=click.Path(path_type=Path))
@option(
    "--positions",
    metavar="SOURCE",
    type=click.Path(path_type=Path),
    help="Recording of 9 or more still positions; gives scale and axes of the accelerometer.",
)
@option(
    "--aligned",
    is_flag=True,
    help="Each position is along an axis of a square block: six positions are enough.",
)
@option(
    "--gravity",
    type=float,
    default=9.80665,
    show_default=True,
    metavar="M/S2",
    help="Gravity at the place.",
)
@option("--topic", metavar="NAME", default="", help="Topic of the IMU in a session or bag.")
@AS_JSON
def calibrate_imu_(
    still: Path,
    out: Path,
    *,
    positions: Path | None,
    aligned: bool,
    gravity: float,
    topic: str,
    as_json: bool,
) -> None:
    """Find noise, bias, scale and axes of an IMU.

    STILL is a recording at rest, for noise and random walk of three hours or more: a CSV file with
    the columns timestamp, ax, ay, az, wx, wy, wz and perhaps temperature, the folder of a session,
    or a bag. Writes the folder OUT: imu.yaml in kalibr's form, imu_model.yaml with bias, matrix and
    temperature, and allan.png. OUT must not exist.
    """
    require("allantools", "scipy", "matplotlib", extra="calibration")
    from grasp_factory.capture.calibration.imu_calibrating import (
        ImuSources,
        calibrate_imu,
        write_imu_calibration,
    )
    from grasp_factory.core.output_folder import check_free

    check_free(out, "a calibration")
    sources = ImuSources(
        still=still, positions=positions, topic=topic, aligned=aligned, gravity=gravity
    )
    found = calibrate_imu(sources)
    write_imu_calibration(found, out)
    if as_json:
        print_json({"noise": found.noise, "model": found.model, "seconds": found.duration_s})
    else:
        say_lines(_lines(out, found))


def _lines(out: Path, found: ImuCalibration) -> Iterator[str]:
    yield f"{out}: {found.duration_s / 60.0:.4g} min at {found.rate_hz:.4g} Hz"
    for name, units, figures in (
        ("accelerometer", ("m/s2", "m/s3"), found.accelerometer),
        ("gyroscope", ("rad/s", "rad/s2"), found.gyroscope),
    ):
        density = ", ".join(f"{axis.density:.3g}" for axis in figures)
        walk = ", ".join(f"{axis.random_walk:.3g}" for axis in figures)
        yield f"{name}: noise density {density} {units[0]}/sqrt(Hz)"
        yield f"{name}: random walk {walk} {units[1]}/sqrt(Hz)"
        if not all(axis.random_walk for axis in figures):
            yield (
                f"{name}: a walk of 0 means that the recording is too short for it; kalibr needs"
                " a value above 0"
            )
    bias = ", ".join(f"{value:.4g}" for value in found.model.gyroscope.bias)
    yield f"gyroscope: bias {bias} rad/s"
    if found.position_fit:
        fit = found.position_fit
        yield f"accelerometer: {fit.positions} positions, gravity within {fit.rms:.2g} m/s2"
    if not found.has_temperature:
        yield "temperature: not measured, or it hardly changed; no slope"
