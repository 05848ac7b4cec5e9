"""The command ``capture`` and the table of its subcommands.

To add a subcommand, write its file in ``cli`` and add it to ``CAPTURE_COMMANDS``.
"""

from __future__ import annotations

from collections.abc import Mapping

import click

from grasp_factory.cli.capture_blur import blur
from grasp_factory.cli.capture_check import check
from grasp_factory.cli.capture_collect import collect, topics
from grasp_factory.cli.capture_cut import cut
from grasp_factory.cli.capture_demo import capture_demo
from grasp_factory.cli.capture_devices import devices
from grasp_factory.cli.capture_import import capture_import
from grasp_factory.cli.capture_info import capture_info, capture_recover
from grasp_factory.cli.capture_publish import publish
from grasp_factory.cli.capture_run import capture_run
from grasp_factory.cli.params import Commands

CAPTURE_COMMANDS: Mapping[str, tuple[click.Command, ...]] = {
    "Record a session": (capture_run, capture_demo, devices),
    "Check and protect a session": (capture_info, check, capture_recover, blur),
    "Make a store": (cut, capture_import),
    "Use topics of ROS 2": (topics, publish, collect),
}
"""Heading in the help to subcommands."""


@click.group(cls=Commands, subcommand_metavar="COMMAND [ARGS]...")
def capture() -> None:
    """Record real sensors, and make stores of what was recorded."""


for _heading, _commands in CAPTURE_COMMANDS.items():
    capture.add_section(_heading, _commands)
