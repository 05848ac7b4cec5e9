"""The command that calibrates a camera: ``calibrate camera``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path

import click

from grasp_factory.cli.board_options import board_from, board_options
from grasp_factory.cli.params import AS_JSON, Command, option
from grasp_factory.cli.printing import print_json, say_lines


@click.command(
    cls=Command,
    name="camera",
    examples=(
        "grasp-factory calibrate camera images camchain.yaml --board 7x5 --square 0.04",
        "grasp-factory calibrate camera session_1764 camchain.yaml --topic /wrist/image",
    ),
)
@click.argument("source", metavar="SOURCE", type=click.Path(path_type=Path))
@click.argument("out", metavar="OUT", type=click.Path(path_type=Path))
@board_options
@option("--topic", metavar="NAME", default="", help="Topic of the images in a session or bag.")
@option(
    "--images",
    "most",
    type=click.IntRange(5, 2000),
    metavar="N",
    default=100,
    show_default=True,
    help="Images that are used; of more, evenly spread ones.",
)
@AS_JSON
def calibrate_camera_(
    source: Path,
    out: Path,
    *,
    board: list[int],
    square: float,
    marker: float,
    dictionary: str,
    topic: str,
    most: int,
    as_json: bool,
) -> None:
    """Find intrinsics and distortion of a camera.

    SOURCE is a folder of images of a ChArUco board, the folder of a session, or a bag. Writes OUT
    in kalibr's form camchain.yaml: a pinhole camera with the distortion radtan (k1, k2, p1, p2).
    Take 15 or more images: the board in all parts of the image, near and far, tilted by 30 degrees
    or more in all directions. OUT must not exist.
    """
    from grasp_factory.capture.calibration.board_images import board_views
    from grasp_factory.capture.calibration.document import check_new
    from grasp_factory.capture.calibration.intrinsics import calibrate_camera
    from grasp_factory.capture.calibration.kalibr import write_camchain
    from grasp_factory.cli.bars import watched

    check_new(out)
    settings = board_from(board, square, marker, dictionary)
    with watched("image", most) as step:
        views = board_views(source, settings, topic=topic, most=most, on_image=step)
    fit = calibrate_camera(views, settings)
    write_camchain(out, [fit.kalibr(topic)])
    if as_json:
        print_json({"camera": fit.kalibr(topic), "rms": fit.rms, "views": fit.views})
        return
    (fx, fy), (cx, cy) = (fit.K[0, 0], fit.K[1, 1]), (fit.K[0, 2], fit.K[1, 2])
    say_lines(
        [
            f"{out}: {fit.views} of {len(views)} images, {fit.corners} corners",
            f"fx {fx:.2f}, fy {fy:.2f}, cx {cx:.2f}, cy {cy:.2f} pixels; standard deviation of the"
            f" focal lengths {max(fit.focal_std):.2f}",
            f"reprojection error {fit.rms:.3f} pixels, largest {fit.worst_rms:.3f} in"
            f" {fit.worst_view}",
            f"corners in {100 * fit.coverage:.0f} % of the image",
        ]
    )
