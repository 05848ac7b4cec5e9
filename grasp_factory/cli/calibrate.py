"""The command ``calibrate`` and the table of its subcommands."""

from __future__ import annotations

from collections.abc import Mapping

import click

from grasp_factory.cli.calibrate_camera import calibrate_camera_
from grasp_factory.cli.calibrate_ft import calibrate_ft_
from grasp_factory.cli.calibrate_hand_eye import calibrate_hand_eye_
from grasp_factory.cli.calibrate_imu import calibrate_imu_
from grasp_factory.cli.params import Commands

CALIBRATE_COMMANDS: Mapping[str, tuple[click.Command, ...]] = {
    "Sensors": (calibrate_imu_, calibrate_ft_),
    "Cameras": (calibrate_camera_, calibrate_hand_eye_),
}
"""Heading in the help to subcommands."""


@click.group(cls=Commands, subcommand_metavar="COMMAND [ARGS]...")
def calibrate() -> None:
    """Calibrate sensors from recordings."""


for _heading, _commands in CALIBRATE_COMMANDS.items():
    calibrate.add_section(_heading, _commands)
