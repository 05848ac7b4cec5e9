"""Episodes as topics between processes, in a network of their own."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from pathlib import Path

import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from support.places import TINY
from support.topic_commands import TopicCommands, ended

from grasp_factory.capture.ros2.clock_topic import CLOCK, ClockTicks, clock_message
from grasp_factory.capture.ros2.message_stamp import stamp_of
from grasp_factory.dataset.dataset import Dataset

pytestmark = pytest.mark.slow
IMU = "sensor_msgs/msg/Imu"
Bag = Mapping[str, list[bytes]]


def bytes_of(path: Path) -> Bag:
    """Return the messages of a file by ``TOPIC TYPE``, without what fills up their last bytes."""
    found: dict[str, list[bytes]] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema
            key = f"{channel.topic} {schema.name}"
            found.setdefault(key, []).append(message.data.rstrip(b"\0"))
    return found


def test_an_episode_that_is_sent_and_collected_is_the_same_to_the_byte(
    topics: TopicCommands, tmp_path: Path
) -> None:
    out = tmp_path / "topics.mcap"
    collecting = topics.start("collect", "--topics", "all", "--silence", 2, "--out", out, "--json")
    code, said, complaint = topics.run("publish", TINY, 1, "--rate", "max", "--wait-for-all")
    assert (code, complaint) == (0, "")
    assert "33 with a subscriber" in said
    code, said, complaint = ended(collecting)
    assert (code, complaint) == (0, "")
    Dataset(TINY).export("rosbag2", tmp_path / "bags", indices=[1])
    sent, received = bytes_of(tmp_path / "bags/000000/000000.mcap"), bytes_of(out)
    assert received == sent
    counts = {topic["name"]: topic for topic in json.loads(said)["topics"]}
    assert {name.split()[0]: len(rows) for name, rows in sent.items()} == {
        name: topic["count"] for name, topic in counts.items()
    }
    assert counts["/imu/data"]["missing"] == counts["/tf"]["missing"] == 0
    assert counts["/streams/phase"]["missing"] is None


@pytest.mark.soak
def test_a_bag_that_is_sent_and_collected_is_the_same_to_the_byte(
    topics: TopicCommands, tmp_path: Path
) -> None:
    Dataset(TINY).export("rosbag2", tmp_path / "bags", indices=[1])
    bag, out = tmp_path / "bags/000000/000000.mcap", tmp_path / "topics.mcap"
    collecting = topics.start("collect", "--topics", "all", "--silence", 2, "--out", out)
    code, said, complaint = topics.run("publish", bag, "--rate", "max", "--wait-for-all")
    assert (code, complaint) == (0, "")
    assert "33 with a subscriber" in said
    assert ended(collecting)[::2] == (0, "")
    assert bytes_of(out) == bytes_of(bag)


def test_the_clock_of_an_episode_is_a_topic_beside_the_others(
    topics: TopicCommands, tmp_path: Path
) -> None:
    out, names = tmp_path / "clock.mcap", ("--topics", "/imu/data,/clock")
    collecting = topics.start("collect", *names, "--silence", 2, "--out", out)
    played = ("--topics", "/imu/data", "--clock", "--rate", "max", "--wait-for-all")
    code, said, complaint = topics.run("publish", TINY, 1, *played)
    assert (code, complaint) == (0, "")
    assert "2 topics, 2 with a subscriber" in said
    assert ended(collecting)[::2] == (0, "")
    sent = bytes_of(out)
    first, *_, last = (stamp_of(IMU, data) for data in sent[f"/imu/data {IMU}"])
    assert first and last
    ticks = ClockTicks(skips_pauses=False)
    times = [*ticks.until(first), *ticks.until(last)]
    assert len(times) > 100
    assert sent[f"/clock {CLOCK.kind}"] == [clock_message(time).rstrip(b"\0") for time in times]


def test_what_is_no_bag_is_refused_in_one_line(topics: TopicCommands, tmp_path: Path) -> None:
    (tmp_path / "no.mcap").write_bytes(b"no bag")
    code, _, complaint = topics.run("publish", tmp_path / "no.mcap", "--wait", 0.1)
    assert (code, complaint.count("\n")) == (2, 1)
    assert "is no ROS bag" in complaint


@pytest.mark.soak
def test_chosen_topics_are_played_slowly_under_other_names(
    topics: TopicCommands, tmp_path: Path
) -> None:
    names = ("--topics", "/imu/data,/label", "--remap", "/imu/data:=/arm/imu")
    playing = topics.start("publish", TINY, 0, "--rate", "0.5", "--wait-for-all", *names)
    code, said, complaint = topics.run(
        "topics", "--topics", "/arm/imu,/label", "--seconds", 1, "--json"
    )
    assert (code, complaint) == (0, "")
    imu, label = json.loads(said)
    assert imu["kinds"] == ["sensor_msgs/msg/Imu"]
    assert imu["count"] > 0
    assert (label["is_latched"], label["reliability"]) == (True, "reliable")
    code, said, complaint = ended(playing)
    assert (code, complaint) == (0, "")


def test_a_collector_that_is_killed_leaves_what_came_half_a_second_before(
    topics: TopicCommands, tmp_path: Path
) -> None:
    out = tmp_path / "killed.mcap"
    collecting = topics.start("collect", "--topics", "/imu/data", "--out", out, "--wait", 60)
    playing = topics.start("publish", TINY, 1, "--topics", "/imu/data", "--wait", 60)
    while not out.exists() or out.stat().st_size < 150_000:
        assert collecting.poll() is None
        time.sleep(0.01)
    collecting.kill()
    playing.kill()
    with out.open("rb") as file, pytest.raises(EndOfFile):
        messages = 0
        for record in StreamReader(file, emit_chunks=False).records:
            messages += isinstance(record, Message)
    assert messages >= 300


def test_without_a_subscriber_playing_fails_in_one_line(topics: TopicCommands) -> None:
    code, said, complaint = topics.run("publish", TINY, 0, "--wait", 0.5)
    assert (code, said) == (1, "")
    assert complaint.count("\n") == 1
    assert "nobody subscribes to any of 33 topics within 0.5 s" in complaint


@pytest.mark.soak
def test_without_a_publisher_collecting_fails_in_one_line_and_leaves_no_file(
    topics: TopicCommands, tmp_path: Path
) -> None:
    for names in (("--topics", "/imu/data"), ("--topics", "all"), ()):
        out = tmp_path / "nothing.mcap"
        code, said, complaint = topics.run("collect", *names, "--wait", 0.3, "--out", out)
        assert (code, said, complaint.count("\n")) == (1, "", 1)
        assert "nobody publishes" in complaint
        assert not out.exists()


def test_no_topics_are_no_error_for_a_list(topics: TopicCommands) -> None:
    code, said, complaint = topics.run("topics", "--look", 0.3, "--seconds", 0.2)
    assert (code, complaint) == (0, "")
    assert said == "no topics are published in domain 0 on the interface lo\n"


def test_an_interface_that_is_not_there_fails_in_one_line(topics: TopicCommands) -> None:
    code, _, complaint = topics.run("topics", "--interface", "eth77")
    assert (code, complaint.count("\n")) == (1, 1)
    assert complaint == "Error: interface: got 'eth77', valid: lo\n"


def test_nothing_is_overwritten(topics: TopicCommands, tmp_path: Path) -> None:
    out = tmp_path / "mine.mcap"
    out.write_text("mine")
    playing = topics.start("publish", TINY, 0, "--topics", "/imu/data")
    code, _, complaint = topics.run("collect", "--topics", "/imu/data", "--out", out)
    assert (code, complaint.count("\n")) == (2, 1)
    assert "mine.mcap exists, and nothing is overwritten" in complaint
    assert out.read_text() == "mine"
    playing.kill()
