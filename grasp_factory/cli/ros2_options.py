"""The options of commands that use topics of ROS 2."""

# ruff: noqa: PLC0415

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import click

from grasp_factory.cli.params import option, options
from grasp_factory.core.optional import require

if TYPE_CHECKING:
    from grasp_factory.capture.ros2.network import Participant

_network = partial(option, heading="Network")

domain_options = options(
    _network(
        "--domain",
        metavar="ID",
        type=click.IntRange(0, 232),
        default=0,
        envvar="ROS_DOMAIN_ID",
        help="Domain id.  [default: that in ROS_DOMAIN_ID, or 0]",
    ),
    _network(
        "--interface",
        metavar="NAME",
        default="lo",
        show_default=True,
        help="Network interface. lo reaches this machine only. Anybody on a network of another one"
        " can read and send.",
    ),
)
"""Adds ``domain`` and ``interface``; the command passes them to ``participant_of``."""
network_options = options(
    domain_options,
    _network(
        "--reliability",
        type=click.Choice(("reliable", "best-effort")),
        default="reliable",
        show_default=True,
        help="Whether messages that were lost are sent again.",
    ),
    _network(
        "--depth",
        metavar="N",
        type=click.IntRange(0, 100_000),
        default=0,
        show_default=True,
        help="Messages that are kept for a slow subscriber; 0 keeps all and waits for it.",
    ),
)
"""Adds the options of a publisher, too."""


def participant_of(domain: int, interface: str) -> Participant:
    """Join a domain.

    Raises:
        MissingLibraryError: if the libraries are not installed.
        CaptureError: if the interface is not there.
    """
    require("cyclonedds", "rosbags", "mcap", extra="ros2")
    from grasp_factory.capture.ros2.network import Participant, Ros2Network

    return Participant(Ros2Network(domain_id=domain, interface=interface))
