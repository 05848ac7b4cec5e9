"""Import of odd bags: nothing is lost in silence, and what is wrong is said in one line."""

from __future__ import annotations

import csv
import json
import multiprocessing
import os
import signal
import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer
from support import bags
from support.bags import COMPRESSED, IMAGE, IMU, JOINTS, Content

from grasp_factory.apps.bag_import.importing import import_bag, list_topics
from grasp_factory.errors import LimitError, StoreError, UsageError

Run = Callable[..., tuple[int, str, str]]
START = 1_700_000_000_000_000_000
PIXELS = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
GOOD = bags.image(PIXELS, "rgb8")


def imus(n: int = 10, **more: Any) -> list[Content]:
    return [("/imu", IMU, START + k, bags.imu((k, 0, 1), (0, 0, 0), **more)) for k in range(n)]


def database(folder: Path) -> Path:
    """Return the database in a bag of ten messages of an IMU."""
    (file,) = bags.sqlite3(folder, imus()).glob("*.db3")
    return file


def changed(file: Path, *statements: str) -> Path:
    """Change a database."""
    with sqlite3.connect(file) as connection:
        for statement in statements:
            connection.execute(statement)
    connection.close()
    return file


def record_and_die(file: Path, mode: str) -> None:
    """Add a message to a database and end without closing it, as a recorder that is killed."""
    connection = sqlite3.connect(file)
    connection.execute(f"pragma journal_mode={mode}")
    connection.execute("pragma cache_size=1")
    connection.execute("pragma cache_spill=1")
    columns = "(topic_id, timestamp, data)"
    connection.execute(f"insert into messages {columns} select 1, timestamp, data from messages")
    if mode == "wal":
        connection.commit()
    else:  # pages of the change are in the database already, and in the journal what was there
        connection.execute("update messages set data = zeroblob(100000)")
    os.kill(os.getpid(), signal.SIGKILL)


def in_a_process_that_dies(task: Callable[..., None], *args: object) -> None:
    process = multiprocessing.get_context("spawn").Process(target=task, args=args)
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL


def rows(path: Path) -> list[dict[str, str]]:
    csv.field_size_limit(10**9)
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("mode", ["wal", "delete"])
def test_a_database_that_lacks_changes_is_refused_until_sqlite_took_them_over(
    run: Run, tmp_path: Path, mode: str
) -> None:
    file = database(tmp_path / "b")
    in_a_process_that_dies(record_and_die, file, mode)
    ending = "wal" if mode == "wal" else "journal"
    (tmp_path / "link.db3").symlink_to(file)
    for bag in (file, file.parent, tmp_path / "link.db3"):
        for words in (("--list",), (tmp_path / "out", "--to", "sequences")):
            code, out, err = run("import", bag, *words)
            assert (code, out, err.count("\n")) == (2, "", 1)
            assert f"{file}-{ending} has changes that {file.name} lacks" in err
            assert "pragma quick_check" in err
    changed(file, "pragma quick_check")
    (imu,) = list_topics(file).topics
    assert imu.count == (20 if mode == "wal" else 10)


def test_a_journal_that_is_done_with_does_not_matter(tmp_path: Path) -> None:
    file = database(tmp_path / "b")
    changed(file, "pragma journal_mode=persist", "update messages set timestamp = timestamp + 1")
    assert Path(f"{file}-journal").stat().st_size > 0
    assert list_topics(file).topics[0].count == 10


def test_messages_whose_topic_is_missing_are_counted(run: Run, tmp_path: Path) -> None:
    file = changed(database(tmp_path / "b"), "update messages set topic_id = 99 where id % 2 = 0")
    for bag in (file, file.parent):
        code, out, _ = run("import", bag, "--list")
        assert code == 0
        assert out.endswith("5 messages cannot be read: the bag does not name their topics\n")
        code, out, _ = run("import", bag, "--list", "--json")
        assert json.loads(out)["without_topic"] == 5
    code, out, _ = run("import", file, tmp_path / "out", "--to", "sequences")
    assert out.endswith("5 messages cannot be read: the bag does not name their topics\n")
    record = json.loads((tmp_path / "out/grasp_factory_import.json").read_text())
    assert record["without_topic"] == 5


def test_messages_of_a_topic_that_the_metadata_does_not_name_are_counted(tmp_path: Path) -> None:
    contents = [*imus(3), ("/other", IMU, START, bags.imu((0, 0, 0), (0, 0, 0)))]
    for name, write in (("a", bags.mcap), ("b", bags.sqlite3)):
        folder = write(tmp_path / name, contents)
        metadata = folder / "metadata.yaml"
        metadata.write_text(metadata.read_text().replace("/other", "/another"))
        assert list_topics(folder).without_topic == 1


WRONG = {
    "update messages set timestamp = 'x' where id = 3": "of /imu has the time 'x'",
    "update messages set timestamp = 1.5e300 where id = 3": "has the time 1.5e+300",
    "update topics set name = x'ff'": r"a topic: got (b'\xff', 'sensor_msgs/msg/Imu', 10)",
    "update topics set type = x'ff'": r"a topic: got ('/imu', b'\xff', 10)",
}


@pytest.mark.parametrize("statement", WRONG)
def test_a_value_of_another_type_in_a_database_is_one_line(
    run: Run, tmp_path: Path, statement: str
) -> None:
    file = changed(database(tmp_path / "b"), statement)
    for words in (("--list",), (tmp_path / "out", "--to", "sequences")):
        code, out, err = run("import", file, *words)
        assert (code, out, err.count("\n")) == (1, "", 1)
        assert f"{file} is damaged: " in err
        assert WRONG[statement] in err


def test_a_count_of_another_type_in_the_metadata_is_one_line(tmp_path: Path) -> None:
    folder = bags.mcap(tmp_path / "b", imus())
    metadata = folder / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("message_count: 10", "message_count: ten"))
    with pytest.raises(StoreError, match=r"a topic: got \('/imu', 'sensor_msgs/msg/Imu', 'ten'\)"):
        import_bag(folder, tmp_path / "out", "sequences")


def test_joints_without_a_name_have_rows_too(tmp_path: Path) -> None:
    fields = [
        {"name": [], "position": np.array([1.0, 2.0]), "effort": np.array([3.0])},
        {"name": ["a"], "position": np.array([4.0, 5.0])},
        {"name": ["a", "b"], "velocity": np.array([6.0])},
    ]
    contents = [("/joints", JOINTS, START + k, more) for k, more in enumerate(fields)]
    import_bag(bags.ros1(tmp_path / "b.bag", contents), tmp_path / "out", "sequences")
    found = rows(tmp_path / "out/sequences/00/joints/data.csv")
    names = ("joint", "position", "velocity", "effort")
    assert [tuple(row[name] for name in names) for row in found] == [
        ("", "1.0", "", "3.0"),
        ("", "2.0", "", ""),
        ("a", "4.0", "", ""),
        ("", "5.0", "", ""),
        ("a", "", "6.0", ""),
        ("b", "", "", ""),
    ]


def test_the_first_message_that_can_be_decoded_says_what_a_topic_is(tmp_path: Path) -> None:
    contents = [("/camera/image", IMAGE, START + k, GOOD) for k in range(1, 10)]
    contents.insert(0, ("/camera/image", IMAGE, START, GOOD | {"encoding": "rgb16"}))
    bag = bags.ros1(tmp_path / "b.bag", contents)
    (topic,) = import_bag(bag, tmp_path / "out", "sequences").topics
    assert (topic.imported, topic.undecodable) == (9, 1)
    assert topic.reason.startswith("encoding 'rgb16', valid: rgb8")
    assert len(list((tmp_path / "out/sequences/00/rgb").iterdir())) == 9


def test_a_topic_of_which_nothing_can_be_decoded_is_listed_with_the_reason(tmp_path: Path) -> None:
    rvl = {"format": "16UC1; compressedDepth rvl", "data": np.zeros(50, np.uint8)}
    deep: list[Content] = [("/depth", COMPRESSED, START + k, rvl) for k in range(3)]
    why = "none of its 3 messages can be decoded, the first because format '16UC1; compressedDepth"
    with pytest.raises(UsageError, match=rf"has no messages to import \(/depth: {why} rvl'"):
        import_bag(bags.ros1(tmp_path / "a.bag", deep), tmp_path / "out", "sequences")
    found = import_bag(bags.ros1(tmp_path / "b.bag", deep + imus()), tmp_path / "out", "sequences")
    assert found.left_out["/depth"].startswith(why)


def test_what_an_imu_did_not_measure_is_empty(tmp_path: Path) -> None:
    none = np.array([-1.0, *[0.0] * 8])
    contents = [
        ("/camera/image", IMAGE, START, GOOD),
        *imus(1, linear_acceleration_covariance=none),
    ]
    other = imus(1, angular_velocity_covariance=none)[0]
    contents.append(("/other", *other[1:]))
    bag = bags.mcap(tmp_path / "b", contents)
    import_bag(bag, tmp_path / "out", "sequences")
    sequence = tmp_path / "out/sequences/00"
    (row,) = rows(sequence / "imu/data.csv")
    assert [row[name] for name in ("ax", "ay", "az", "wx")] == ["", "", "", "0.0"]
    (row,) = rows(sequence / "imu_1/data.csv")
    assert [row[name] for name in ("az", "wx", "wy", "wz")] == ["1.0", "", "", ""]
    (frame,) = json.loads((sequence / "sync_metadata.json").read_text())
    assert frame["imu"]["linear_acceleration"] == [None] * 3


@pytest.mark.parametrize("layout", ["sequences", "article"])
def test_names_of_any_length_are_sorted(tmp_path: Path, layout: str) -> None:
    name = "n" * 200_000
    contents: list[Content] = [
        (f"/{name}", IMU, START + k, bags.imu((k, 0, 0), (0, 0, 0), stamp=START - k))
        for k in range(3)
    ]
    joints = {"name": [f"{name}\n=é", "b"]}
    contents += [("/j", JOINTS, START + k, joints | {"stamp": START - k}) for k in range(3)]
    import_bag(bags.ros1(tmp_path / "b.bag", contents), tmp_path / "out", layout)
    files = list((tmp_path / "out").rglob("*.csv"))
    assert len(files) == (2 if layout == "sequences" else 1)
    for file in files:
        stamps = [row["timestamp"].replace(".", "") for row in rows(file)]
        assert stamps == sorted(stamps)
        assert set(stamps) == {str(START - k) for k in range(3)}
        assert [path.name for path in file.parent.iterdir() if "unsorted" in path.name] == []
    if layout == "sequences":
        found = rows(tmp_path / "out/sequences/00/joints/data.csv")
        assert [row["joint"] for row in found] == [f"{name}\\n=é", "b"] * 3


def test_a_time_before_1970_is_a_number(tmp_path: Path) -> None:
    file = database(tmp_path / "b")
    contents: list[Content] = [
        ("/imu", IMU, START, bags.imu((0, 0, 1), (0, 0, 0), stamp=0)) for _ in range(2)
    ]
    (file,) = bags.sqlite3(tmp_path / "c", contents).glob("*.db3")
    changed(file, "update messages set timestamp = -1500000001 where id = 1")
    changed(file, "update messages set timestamp = 5 where id = 2")
    import_bag(file, tmp_path / "out", "sequences")
    found = rows(tmp_path / "out/sequences/00/imu/data.csv")
    assert [row["timestamp"] for row in found] == ["-1.500000001", "0.000000005"]


@pytest.mark.parametrize("name", ["a?b", "a#b", "a%41", "a&mode=rwc"])
def test_signs_of_a_uri_in_the_name_of_out_do_not_matter(tmp_path: Path, name: str) -> None:
    file = database(tmp_path / "b")
    import_bag(file, tmp_path / name, "sequences")
    import_bag(file.parent, tmp_path / name / "more", "sequences")
    for folder in (tmp_path / name, tmp_path / name / "more"):
        assert len(rows(folder / "sequences/00/imu/data.csv")) == 10
    assert len(list(tmp_path.iterdir())) == 2


def test_a_topic_that_is_named_twice_is_refused(run: Run, tmp_path: Path) -> None:
    bag = bags.ros1(tmp_path / "b.bag", imus())
    code, _, err = run("import", bag, tmp_path / "out", "--to=sequences", "--topics", "/imu,/imu")
    assert code == 2
    assert "--topics: '/imu' is named twice; name each topic once" in err
    assert list(tmp_path.iterdir()) == [bag]


def described(file: Path, topics: int, definition: str, qos: str = "") -> Path:
    """Return an MCAP file with a message on the last of some topics."""
    with file.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="")
        for k in range(topics):
            schema = writer.register_schema("a/msg/B", "ros2msg", definition.encode())
            told = {"offered_qos_profiles": qos}
            channel = writer.register_channel(f"/t{k}", "cdr", schema, told)
        writer.add_message(channel, log_time=1, publish_time=1, data=bytes(12))
        writer.finish()
    return file


FIELDS = "".join(f"float64 x{k}\n" for k in range(11_000))


@pytest.mark.parametrize(
    ("topics", "definition", "qos", "words"),
    [
        (2001, "float64 x", "", "a number of topics of 2,001, valid: up to 2,000; .* bag-topics=N"),
        (1, FIELDS, "", r"'a/msg/B': the definition of a message of 1.*bag-message=SIZE"),
        (1500, "float64 x", "#" * 400, "descriptions of topics and messages of .* bag-texts=SIZE"),
    ],
)
def test_what_a_bag_says_of_its_topics_is_bounded_before_it_is_parsed(
    tmp_path: Path, topics: int, definition: str, qos: str, words: str
) -> None:
    with pytest.raises(LimitError, match=words):
        list_topics(described(tmp_path / "b.mcap", topics, definition, qos))


def test_records_without_end_after_the_messages_of_a_bag_are_refused(tmp_path: Path) -> None:
    file = described(tmp_path / "b.mcap", 1, "float64 x")
    content, footer = file.read_bytes(), struct.Struct("<BQQQI8s")
    kind, length, start, _, _, magic = footer.unpack(content[-footer.size :])
    empty = struct.pack("<BQ", 0x80, 0) * 200_000
    end = footer.pack(kind, length, start, 0, 0, magic)
    file.write_bytes(content[: -footer.size] + empty + end)
    with pytest.raises(LimitError, match=r"a number of records after the messages of 200,001"):
        list_topics(file)


def test_a_folder_with_much_in_its_metadata_is_refused(tmp_path: Path) -> None:
    bag = bags.mcap(tmp_path / "b", imus())
    with (bag / "metadata.yaml").open("a") as file:
        file.write("#" * 2**19)
    with pytest.raises(LimitError, match=r"metadata\.yaml: descriptions of topics"):
        list_topics(bag)


def test_a_definition_that_many_topics_have_is_parsed_once(tmp_path: Path) -> None:
    facts = list_topics(described(tmp_path / "b.mcap", 300, f"{FIELDS[:60_000]}\nfloat64 y\n# c"))
    assert len(facts.topics) == 300  # parsed 300 times, it would exceed the limit of time
