"""Sessions are read as they were recorded, and a damaged or hostile one is one line."""

from __future__ import annotations

import json
import os
import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray
from support.sessions import IMU, JOINTS, START, Channel, Recorded, SessionMaker

from grasp_factory.capture.ros_messages import decoded, definition_of
from grasp_factory.capture.samples import DeviceKind
from grasp_factory.capture.session_reader import SessionReader, opened_session
from grasp_factory.capture.session_series import SeriesBuilder, read_series, unwrapped
from grasp_factory.capture.session_settings import session_settings
from grasp_factory.core.limits import VARIABLE
from grasp_factory.errors import CaptureError, GraspFactoryError, IrregularFileError, LimitError

Run = Callable[..., tuple[int, str, str]]


def maker() -> SessionMaker:
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (6, 8, 3), np.uint8) for _ in range(3)]
    out = SessionMaker(settings={"operator": "op1"}).camera(images).event("start")
    out.imu(rng.normal(size=(8, 3)), rng.normal(size=(8, 3)), 400.0, clock=1.5)
    return out.wrench(rng.normal(size=(5, 6)), 1000.0).joints(rng.normal(size=(4, 7)), 500.0)


@pytest.mark.parametrize("compression", list(CompressionType))
def test_series_have_the_values_and_all_times_of_each_device(
    tmp_path: Path, compression: CompressionType
) -> None:
    made = maker()
    found = read_series(made.write(tmp_path / "in", compression=compression, chunk_size=500))
    assert {name: len(each) for name, each in found.items()} == {
        "/arm/joint_states": 4,
        "/cam/image": 3,
        "/events": 1,
        "/ft/wrench": 5,
        "/imu/imu": 8,
    }
    imu, camera = found["/imu/imu"], found["/cam/image"]
    rows = [each for each in made.messages if each.channel.kind == IMU]
    assert (imu.kind, imu.device) == (DeviceKind.IMU, "imu")
    assert imu.log_time_ns.tolist() == [row.log_ns for row in rows]
    assert imu.device_ns is not None
    assert imu.device_ns.tolist() == [row.device_ns for row in rows]
    assert imu.sequence is not None
    assert imu.sequence.tolist() == list(range(8))
    forces = [row.fields["linear_acceleration"] for row in rows]
    assert imu.values["specific_force"].tolist() == [[f.x, f.y, f.z] for f in forces]
    assert camera.device_ns is None
    assert camera.values == {}
    assert found["/ft/wrench"].values["wrench"].shape == (5, 6)
    assert found["/ft/wrench"].sequence is None
    assert found["/arm/joint_states"].values["positions"].shape == (4, 7)
    assert found["/events"].kind is None


def test_settings_of_a_session_are_read(tmp_path: Path) -> None:
    assert session_settings(maker().write(tmp_path / "in")) == {"operator": "op1"}


@given(hnp.arrays(np.int64, st.integers(0, 30), elements=st.integers(0, 2**30)), st.integers(0))
def test_a_wrapped_count_goes_on(steps: NDArray[np.int64], start: int) -> None:
    count = start % 2**40 + np.cumsum(steps)
    found = unwrapped(count % 2**32)
    assert np.array_equal(np.diff(found), np.diff(count))


def test_a_count_may_go_back() -> None:
    assert unwrapped(np.array([5, 7, 6, 8])).tolist() == [5, 7, 6, 8]
    assert unwrapped(np.array([0, 2**32 - 1])).tolist() == [0, -1]


def test_a_session_without_an_end_says_how_to_recover_it(tmp_path: Path, run: Run) -> None:
    file = maker().write(tmp_path / "in") / "session.mcap"
    file.write_bytes(file.read_bytes()[:-30])
    code, _, err = run("capture", "check", tmp_path / "in")
    assert (code, err.count("\n")) == (1, 1)
    assert f"run `grasp-factory capture recover {tmp_path / 'in'}`" in err
    (tmp_path / "in/session.json").unlink()  # a killed recorder has written none
    assert run("capture", "recover", tmp_path / "in")[0] == 0
    code, _, err = run("capture", "check", tmp_path / "in")
    assert code == 0, err


@pytest.mark.parametrize("command", [("check",), ("blur", "out"), ("import", "--out", "out")])
@pytest.mark.parametrize(
    "damage", ["empty", "text", "folder", "link", "pipe", "none", "yaml", "list", "no yaml"]
)
def test_what_is_no_session_is_one_line(
    tmp_path: Path,
    run: Run,
    monkeypatch: pytest.MonkeyPatch,
    damage: str,
    command: tuple[str, ...],
) -> None:
    folder = maker().write(tmp_path / "in")
    file, settings = folder / "session.mcap", folder / "session.yaml"
    if damage in ("yaml", "list"):
        settings.write_text("a: [" if damage == "yaml" else "[1]")
    elif damage == "no yaml":
        settings.unlink()
    elif damage in ("empty", "text"):
        file.write_bytes(b"" if damage == "empty" else b"hello, this is no MCAP file")
    else:
        file.rename(tmp_path / "elsewhere")
        if damage == "folder":
            file.mkdir()
        elif damage == "link":
            file.symlink_to(tmp_path / "elsewhere")
        elif damage == "pipe":
            os.mkfifo(file)
    name, *out = command
    monkeypatch.chdir(tmp_path)
    code, _, err = run("capture", name, folder, *out)
    assert (code, err.count("\n")) == (1, 1), err
    assert str(folder) in err
    assert not (tmp_path / "out").exists()


def test_a_record_and_a_chunk_that_claim_to_be_huge_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = maker().write(tmp_path / "in", compression=CompressionType.NONE)
    file = folder / "session.mcap"
    content = file.read_bytes()
    first = 8 + 1  # magic, opcode
    file.write_bytes(content[:first] + struct.pack("<Q", 2**40) + content[first + 8 :])
    with pytest.raises(CaptureError, match="exceeds limit"):
        read_series(folder)
    file.write_bytes(content)
    monkeypatch.setenv(VARIABLE, "chunk=2000")
    monkeypatch.setattr("grasp_factory.core.limits.Limit.most", 10_000)
    read_series(folder)
    monkeypatch.setattr("grasp_factory.core.limits.Limit.most", 2000)
    with pytest.raises(GraspFactoryError):
        read_series(folder)


@example(150, 6)  # a chunk that says to have 25 GB
@given(st.integers(0, 10**6), st.integers(1, 255))
def test_a_flipped_byte_is_an_error_or_harmless(
    tmp_path_factory: pytest.TempPathFactory, at: int, flip: int
) -> None:
    content = bytearray(small_file(tmp_path_factory))
    content[at % len(content)] ^= flip
    folder = tmp_path_factory.mktemp("flipped")
    (folder / "session.mcap").write_bytes(content)
    try:
        with opened_session(folder) as reader:
            found = [decoded(message) for message in reader.messages()]
    except (CaptureError, LimitError) as error:
        assert "\n" not in str(error)
    else:
        assert len(found) <= 8


_small: list[bytes] = []


def small_file(factory: pytest.TempPathFactory) -> bytes:
    if not _small:
        made = SessionMaker().event("start").wrench(np.ones((3, 6)), 1000.0)
        folder = made.write(factory.mktemp("small") / "in", compression=CompressionType.NONE)
        _small.append((folder / "session.mcap").read_bytes())
    return _small[0]


def write_raw(folder: Path, kind: str, definition: str, data: bytes, encoding: str = "cdr") -> Path:
    """Write a session with one message of any bytes."""
    folder.mkdir()
    (folder / "session.yaml").write_text("{}")
    with (folder / "session.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "x")
        schema = writer.register_schema(kind, "ros2msg", definition.encode())
        channel = writer.register_channel("/x\x1b[31m", encoding, schema, {"kind": "imu"})
        writer.add_message(channel, START, data, START)
        writer.finish()
    return folder


@pytest.mark.parametrize(
    ("definition", "encoding", "said"),
    [
        (definition_of(IMU), "cdr", "no sensor_msgs/msg/Imu"),
        ("float64 linear_acceleration", "cdr", "not that of ROS 2 Humble"),
        ("no definition %", "cdr", "not that of ROS 2 Humble"),
        (definition_of(IMU), "json", "valid: messages of ROS 2 Humble as 'cdr'"),
    ],
    ids=["bytes", "definition", "text", "encoding"],
)
def test_a_message_that_does_not_fit_its_type_is_one_line(
    tmp_path: Path, run: Run, definition: str, encoding: str, said: str
) -> None:
    folder = write_raw(tmp_path / "in", IMU, definition, b"\x00\x01\x00\x00abc", encoding)
    code, _, err = run("capture", "check", folder)
    assert (code, err.count("\n")) == (1, 1), err
    assert said in err
    assert "\x1b" not in err


def test_other_types_of_messages_are_counted_and_not_decoded(tmp_path: Path) -> None:
    folder = write_raw(tmp_path / "in", "my_msgs/msg/Thing", "float64 x", b"\x00\x01\x00\x00")
    (found,) = read_series(folder).values()
    assert (len(found), found.values) == (1, {})


def test_joints_that_change_their_number_are_refused(tmp_path: Path) -> None:
    made = SessionMaker().joints(np.zeros((1, 6)), 500.0).joints(np.zeros((1, 7)), 500.0)
    with pytest.raises(CaptureError, match="different numbers of values"):
        read_series(made.write(tmp_path / "in"))


def test_a_gripper_that_is_read_less_often_than_the_arm_is_nan_between(tmp_path: Path) -> None:
    arm = Channel(topic="/arm/joint_states", kind=JOINTS, device="arm", device_kind="joints")
    made = SessionMaker()
    for k, names in enumerate((["a", "b"], ["a", "gripper", "b"], ["a", "b"])):
        values = np.arange(len(names)) + 10.0 * k
        fields = {"name": names, "position": values, "velocity": values, "effort": np.array([])}
        made.messages.append(Recorded(channel=arm, log_ns=START + k, fields=fields))
    found = read_series(made.write(tmp_path / "in"))["/arm/joint_states"]
    expected = [[0, 1, np.nan], [10, 12, 11], [20, 21, np.nan]]
    assert found.has_gripper
    assert np.array_equal(found.values["positions"], expected, equal_nan=True)
    assert found.values["efforts"].shape == (3, 0)


@pytest.mark.usefixtures("isolated")
def test_a_session_is_read_in_a_process_with_limits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    zeros = np.zeros((2000, 3000, 3), np.uint8)
    folder = SessionMaker().camera([zeros] * 3).write(tmp_path / "in")
    assert (folder / "session.mcap").stat().st_size < 2**20
    monkeypatch.setenv(VARIABLE, "session-memory=32MiB")
    with pytest.raises(LimitError, match="reading the session needs more than"):
        read_series(folder)


def test_a_sample_takes_the_bytes_of_its_numbers_alone(tmp_path: Path) -> None:
    folder = SessionMaker().wrench(np.zeros((4000, 6)), 1000.0).write(tmp_path / "in")
    with opened_session(folder) as reader:
        messages = list(reader.messages())
    builder = SeriesBuilder(messages[0].topic)
    tracemalloc.start()
    for message in messages:
        builder.add(message)
    used, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert used < 2 * 8 * (3 + 6) * len(messages)


def test_the_link_itself_may_lead_to_a_session(tmp_path: Path) -> None:
    (tmp_path / "latest").symlink_to(maker().write(tmp_path / "in"))
    assert len(read_series(tmp_path / "latest")) == 5


def test_a_reader_can_be_read_again(tmp_path: Path) -> None:
    with opened_session(maker().write(tmp_path / "in")) as reader:
        counts = [len(list(reader.messages())) for _ in range(2)]
        assert isinstance(reader, SessionReader)
        assert reader.position == reader.size - 8
    assert counts == [21, 21]


def test_an_event_is_a_text(tmp_path: Path) -> None:
    with opened_session(SessionMaker().event("start").write(tmp_path / "in")) as reader:
        (message,) = reader.messages()
    assert json.loads(decoded(message).data)["event"] == "start"


def test_an_irregular_file_is_named(tmp_path: Path) -> None:
    folder = maker().write(tmp_path / "in")
    (folder / "session.mcap").unlink()
    os.mkfifo(folder / "session.mcap")
    with pytest.raises(IrregularFileError), opened_session(folder):
        pass
