"""The command that plays episodes and recordings as topics of ROS 2: ``capture publish``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from grasp_factory.cli.params import AS_JSON, Command, option
from grasp_factory.cli.printing import print_json, say
from grasp_factory.cli.ros2_options import network_options, participant_of
from grasp_factory.core.text_format import count
from grasp_factory.errors import UsageError

if TYPE_CHECKING:
    from grasp_factory.capture.ros2.playing import Played


@click.command(
    cls=Command,
    examples=(
        "grasp-factory capture publish grasps.zarr 3",
        "grasp-factory capture publish grasps.zarr 3 --rate max --wait-for-all",
        "grasp-factory capture publish drive.mcap --rate 2",
        "grasp-factory capture publish grasps.zarr 3 --topics /imu/data --rate 0.5",
    ),
)
@click.argument("source", metavar="SOURCE", type=click.Path(path_type=Path))
@click.argument("episode", metavar="[EPISODE]", required=False, type=click.IntRange(min=0))
@option(
    "--rate",
    metavar="FACTOR",
    default="1",
    show_default=True,
    help="How fast: 1 as it was recorded, 0.5 half as fast, max without waiting.",
)
@option("--topics", metavar="NAME,...", multiple=True, help="Only these topics. Repeatable.")
@option(
    "--remap",
    "new_names",
    metavar="OLD:=NEW",
    multiple=True,
    help="Publish a topic under another name. Repeatable.",
)
@option(
    "--wait",
    "match_s",
    metavar="SECONDS",
    type=float,
    default=10.0,
    show_default=True,
    help="Longest time to wait for a subscriber. The command fails if none comes.",
)
@option("--clock", is_flag=True, help="Send the recording's time on /clock, for use_sim_time.")
@option("--wait-for-all", is_flag=True, help="Wait until every topic has a subscriber.")
@network_options
@AS_JSON
def publish(
    source: Path,
    episode: int | None,
    *,
    rate: str,
    topics: tuple[str, ...],
    new_names: tuple[str, ...],
    match_s: float,
    clock: bool,
    wait_for_all: bool,
    reliability: str,
    depth: int,
    domain: int,
    interface: str,
    as_json: bool,
) -> None:
    """Play an episode or a recording as ROS 2 topics.

    SOURCE is a store, with the number of an episode, or a bag of ROS 2, or the folder of a session.
    The topics of an episode and their values are those of `export --to rosbag2`. No ROS
    installation is needed. The first message is sent when a subscriber is there. The command ends
    when all reliable subscribers have every message.
    """
    participant = participant_of(domain, interface)
    from grasp_factory.capture.ros2.bag_source import play_bag
    from grasp_factory.capture.ros2.episode_source import play_episode
    from grasp_factory.capture.ros2.play_clock import PlayRate
    from grasp_factory.capture.ros2.playing import PlaySettings, TopicPlayer
    from grasp_factory.capture.ros2.quality_of_service import Reliability
    from grasp_factory.capture.ros2.topic_choice import TopicChoice, parse_names
    from grasp_factory.cli.bars import counted

    settings = PlaySettings(
        rate=PlayRate.parse(rate),
        reliability=Reliability(reliability),
        depth=depth,
        match_s=match_s,
        waits_for_all=wait_for_all,
        with_clock=clock,
    )
    choice = TopicChoice(
        topics=tuple(name for text in topics for name in text.split(",")),
        names=parse_names(new_names),
    )
    player = TopicPlayer(participant, settings)
    with counted("on_message", "message") as hooks:
        if episode is None:
            _check_is_no_store(source)
            played = play_bag(source, choice, player, **hooks)
        else:
            played = play_episode(source, episode, choice, player, **hooks)
    if as_json:
        print_json(played)
    else:
        what = str(source) if episode is None else f"{source}: episode {episode}"
        say(_text(what, played))


def _check_is_no_store(source: Path) -> None:
    if (source / "zarr.json").exists():
        raise UsageError(f"{source} is a store: name the EPISODE to play, such as 0")


def _text(what: str, played: Played) -> str:
    sent = sum(played.sent.values())
    return (
        f"{what}: sent {count(sent, 'message')} on {count(len(played.sent), 'topic')},"
        f" {played.subscribed} with a subscriber, in {played.duration_s:.1f} s; the latest was"
        f" {1e3 * played.latest_s:.1f} ms late"
    )
