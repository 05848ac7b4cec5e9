"""The command that calibrates a force-torque sensor: ``calibrate ft``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path

import click

from grasp_factory.cli.params import AS_JSON, Command, option
from grasp_factory.cli.printing import print_json, say_lines
from grasp_factory.errors import UsageError


@click.command(
    cls=Command,
    name="ft",
    examples=(
        "grasp-factory calibrate ft ft.yaml --tare still.csv",
        "grasp-factory calibrate ft new.yaml --tare session_1 --from f.yaml --topic /ft",
        "grasp-factory calibrate ft ft.yaml --poses poses.csv",
    ),
)
@click.argument("out", metavar="OUT", type=click.Path(path_type=Path))
@option(
    "--tare",
    metavar="SOURCE",
    type=click.Path(path_type=Path),
    help="Recording without load: CSV file (timestamp, fx, fy, fz, tx, ty, tz), session or bag.",
)
@option(
    "--poses",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="CSV file of still poses with known loads: finds zero, tool and matrix.",
)
@option(
    "--from",
    "before",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Calibration until now: its matrix is kept, and its zero shows a load.",
)
@option(
    "--samples",
    metavar="N",
    type=int,
    default=100,
    show_default=True,
    help="Samples of the tare.",
)
@option("--topic", metavar="NAME", default="", help="Topic of the wrench in a session or bag.")
@AS_JSON
def calibrate_ft_(
    out: Path,
    *,
    tare: Path | None,
    poses: Path | None,
    before: Path | None,
    samples: int,
    topic: str,
    as_json: bool,
) -> None:
    """Find zero, matrix and tool of a force-torque sensor.

    Writes OUT, a YAML file with matrix, zero, tool mass and centre of mass: a wrench is matrix
    times (raw - zero). With --tare, the zero is the mean of the first samples. It is refused if the
    wrench varies or drifts, or is away from the zero of --from. With --poses, all values come from
    still poses with known loads; --from gives a matrix that is known. OUT must not exist.
    """
    from grasp_factory.capture.calibration.document import check_new
    from grasp_factory.capture.calibration.ft_calibration import (
        identified,
        read_ft,
        tared,
        write_ft,
    )
    from grasp_factory.capture.calibration.tare import TareRule

    if (tare is None) is (poses is None):
        raise UsageError("calibrate ft needs --tare or --poses, one of them")
    check_new(out)
    known = None if before is None else read_ft(before)
    lines = []
    if tare is not None:
        calibration = tared(tare, known, TareRule(samples=samples), topic)
        if known is None:
            lines.append("a constant load cannot be seen without --from; was the tool free?")
    else:
        assert poses is not None
        calibration, fit = identified(poses, known)
        lines += [
            f"tool: {fit.tool_mass:.4g} kg",
            f"rest: {fit.force_rms:.3g} N, {fit.torque_rms:.3g} N m",
            f"condition number: {fit.condition:.3g}; below 1000 is good",
        ]
    write_ft(out, calibration)
    if as_json:
        print_json(calibration)
    else:
        zero = ", ".join(f"{value:.6g}" for value in calibration.zero)
        say_lines([f"{out}: zero {zero}", *lines])
