"""The command that finds where a camera sits on a robot: ``calibrate hand-eye``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path

import click

from grasp_factory.cli.board_options import board_from, board_options
from grasp_factory.cli.params import AS_JSON, Command, option
from grasp_factory.cli.printing import print_json, say_lines
from grasp_factory.errors import UsageError


@click.command(
    cls=Command,
    name="hand-eye",
    examples=(
        "grasp-factory calibrate hand-eye pairs.json camera_on_hand.yaml",
        "grasp-factory calibrate hand-eye pairs.csv camera.yaml --setup to-hand",
        "grasp-factory calibrate hand-eye images out.yaml --poses p.csv --camera c.yaml",
    ),
)
@click.argument("source", metavar="SOURCE", type=click.Path(path_type=Path))
@click.argument("out", metavar="OUT", type=click.Path(path_type=Path))
@option(
    "--setup",
    type=click.Choice(["in-hand", "to-hand"]),
    default="in-hand",
    show_default=True,
    help="Camera on the gripper, or camera in the world and board on the gripper.",
)
@option(
    "--poses",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="If SOURCE has images: CSV file with the gripper's pose for each image.",
)
@option(
    "--camera",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="If SOURCE has images: camchain.yaml with the intrinsics of cam0.",
)
@board_options
@AS_JSON
def calibrate_hand_eye_(
    source: Path,
    out: Path,
    *,
    setup: str,
    poses: Path | None,
    camera: Path | None,
    board: list[int],
    square: float,
    marker: float,
    dictionary: str,
    as_json: bool,
) -> None:
    """Find where a camera sits on a robot.

    SOURCE is a JSON or CSV file with pairs of poses, T_base_gripper and T_camera_target, or a
    folder of images of a ChArUco board. Take 10 to 20 poses with turns of 30 degrees or more about
    different axes. Writes OUT, a YAML file with the camera's pose: in the gripper's frame for
    in-hand, in the base's frame for to-hand. OUT must not exist.
    """
    from grasp_factory.capture.calibration.document import check_new
    from grasp_factory.capture.calibration.hand_eye import HandEyeSetup, calibrate_hand_eye
    from grasp_factory.capture.calibration.hand_eye_file import write_hand_eye
    from grasp_factory.capture.calibration.kalibr import read_camchain
    from grasp_factory.capture.calibration.pose_pairs import pairs_of_images, read_pairs
    from grasp_factory.cli.bars import watched

    if (poses is None) is not (camera is None):
        raise UsageError("--poses and --camera belong together: both for images, none for pairs")
    check_new(out)
    if poses is None or camera is None:
        pairs = read_pairs(source)
    else:
        settings = board_from(board, square, marker, dictionary)
        with watched("image", 0) as step:
            pairs = pairs_of_images(source, poses, read_camchain(camera)[0], settings, step)
    fit = calibrate_hand_eye(pairs, HandEyeSetup[setup.replace("-", "_").upper()])
    write_hand_eye(out, fit)
    if as_json:
        print_json({"setup": fit.setup, "transform": fit.transform.tolist(), "pairs": fit.pairs})
        return
    x, y, z = fit.transform[:3, 3] * 1e3
    say_lines(
        [
            f"{out}: {fit.pairs} pairs, camera at {x:.1f}, {y:.1f}, {z:.1f} mm",
            f"the pairs agree on the board within {fit.position_rms * 1e3:.2f} mm and"
            f" {fit.rotation_rms * 57.29578:.3f} degrees",
        ]
    )
