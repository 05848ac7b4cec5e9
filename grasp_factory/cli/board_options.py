"""The options of a ChArUco board."""

from __future__ import annotations

from typing import TYPE_CHECKING

from grasp_factory.cli.params import option, options, resolution

if TYPE_CHECKING:
    from grasp_factory.capture.calibration.board import BoardSettings

board_options = options(
    option(
        "--board",
        type=resolution,
        metavar="CxR",
        default="7x5",
        show_default=True,
        help="Squares of the ChArUco board in a row, and rows.",
    ),
    option(
        "--square",
        type=float,
        metavar="M",
        default=0.04,
        show_default=True,
        help="Side of a square, metres, as measured on the print.",
    ),
    option(
        "--marker",
        type=float,
        metavar="M",
        default=0.03,
        show_default=True,
        help="Side of a marker, metres.",
    ),
    option(
        "--dictionary",
        metavar="NAME",
        default="4x4_50",
        show_default=True,
        help="ArUco dictionary, such as 4x4_50 or 5x5_100.",
    ),
)
"""Adds the options; ``board_from`` makes the settings of their values."""


def board_from(board: list[int], square: float, marker: float, dictionary: str) -> BoardSettings:
    """Return the settings of a board.

    Raises:
        ConfigError: naming the value that is out of range.
    """
    from grasp_factory.capture.calibration.board import BoardSettings  # noqa: PLC0415

    columns, rows = board
    return BoardSettings(
        columns=columns, rows=rows, square_m=square, marker_m=marker, dictionary=dictionary
    )
