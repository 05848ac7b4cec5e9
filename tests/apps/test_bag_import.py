"""Import of ROS bags: every value at its stamp, in both layouts, and bags from strangers."""

from __future__ import annotations

import csv
import errno
import json
import os
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from support import bags
from support.bags import COMPRESSED, IMAGE, IMU, INFO, JOINTS, ODOMETRY, WRENCH, WRITERS, Content
from support.faulty_disk import FaultyDisk
from support.helpers import tree
from support.places import TINY

from grasp_factory.apps.bag_import import importing
from grasp_factory.apps.bag_import.importing import import_bag, list_topics
from grasp_factory.capture.bags.pixel_decoding import ENCODINGS
from grasp_factory.core.executors import LimitedExecutor, import_process
from grasp_factory.core.limits import VARIABLE
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import LimitError, StoreError, UnknownNameError, UsageError

Run = Callable[..., tuple[int, str, str]]
START = 1_700_000_000_123_456_789
STEP = 100_000_000
FRAMES = 5
COLOUR, DEPTH = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"


def colour(k: int) -> NDArray[np.uint8]:
    return np.random.default_rng(k).integers(0, 256, (6, 8, 3), np.uint8)


def depth(k: int) -> NDArray[np.uint16]:
    return np.random.default_rng(100 + k).integers(0, 65536, (6, 8), np.uint16)


def recording() -> list[Content]:
    """Return the messages of a small robot; each arrives 5 ns after its stamp."""
    out: list[Content] = []
    for k in range(FRAMES):
        at = START + k * STEP
        fields = (
            (COLOUR, IMAGE, bags.image(colour(k), "rgb8", padding=3)),
            (DEPTH, IMAGE, bags.image(depth(k), "16UC1") | {"stamp": at + 1000}),
            ("/camera/color/camera_info", INFO, {"k": np.arange(9.0), "width": 8, "height": 6}),
            ("/imu/data", IMU, bags.imu((k, 2, 3), (4, 5, float("nan")))),
            ("/odom", ODOMETRY, bags.odometry((k, 2, 3), (0, 0, 0, 1))),
            ("/joint_states", JOINTS, {"name": ["a", "b=1"], "position": np.array([0.1, k])}),
            ("/ft", WRENCH, bags.wrench((k, 2, 3), (4, 5, 6))),
            ("/chatter", "std_msgs/msg/String", {"data": "hello"}),
        )
        out += [(name, kind, at + 5, {"stamp": at} | more) for name, kind, more in fields]
    return out


def read_csv(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def read_rgb(path: Path) -> NDArray[Any]:
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1]


def read_grey(path: Path) -> NDArray[Any]:
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


def stamp(k: int) -> str:
    return f"{START + k * STEP:019d}"


@pytest.mark.parametrize("name", WRITERS)
def test_a_sequence_has_every_message_at_the_stamp_of_its_header(tmp_path: Path, name: str) -> None:
    bag = WRITERS[name](tmp_path / name, recording())
    found = import_bag(bag, tmp_path / "out", "sequences")
    sequence = tmp_path / "out/sequences/00"
    assert [path.name for path in (tmp_path / "out/sequences").iterdir()] == ["00"]
    frames = json.loads((sequence / "metadata.json").read_text())
    synchronized = json.loads((sequence / "sync_metadata.json").read_text())
    for k, (frame, other) in enumerate(zip(frames, synchronized, strict=True)):
        assert (frame["frame_id"], frame["timestamp_ns"]) == (k, START + k * STEP)
        assert frame["timestamp"] == (START + k * STEP) / 1e9
        np.testing.assert_array_equal(read_rgb(sequence / frame["rgb_path"]), colour(k))
        np.testing.assert_array_equal(read_grey(sequence / frame["depth_path"]), depth(k))
        assert frame["camera_info"]["K"] == list(range(9))
        assert other["imu"]["linear_acceleration"] == [k, 2, 3]
        assert other["imu"]["angular_velocity"] == [4, 5, None]
    assert len(frames) == FRAMES
    assert json.loads((sequence / "calibration/cam_intrinsics.json").read_text())["width"] == 8
    times = [f"{text[:-9]}.{text[-9:]}" for text in map(stamp, range(FRAMES))]
    imu = read_csv(sequence / "imu/data.csv")
    assert [row["timestamp"] for row in imu] == times
    assert [float(row["ax"]) for row in imu] == list(range(FRAMES))
    assert {row["wz"] for row in imu} == {""}
    force = read_csv(sequence / "force/data.csv")
    assert [[float(row[n]) for n in ("fx", "tz")] for row in force] == [[k, 6] for k in range(5)]
    poses = read_csv(sequence / "odometry/data.csv")
    assert [[float(row[n]) for n in ("px", "qw")] for row in poses] == [[k, 1] for k in range(5)]
    joints = read_csv(sequence / "joints/data.csv")
    assert [row["timestamp"] for row in joints] == [time for time in times for _ in "ab"]
    assert [(row["joint"], float(row["position"])) for row in joints[:2]] == [
        ("a", 0.1),
        ("b=1", 0),
    ]
    assert {row["velocity"] for row in joints} == {""}
    assert {topic.name: topic.imported for topic in found.topics} == {
        topic: FRAMES for topic, *_ in recording()[:7]
    }
    assert list(found.left_out) == ["/chatter"]
    info = yaml.safe_load((tmp_path / "out/dataset_info.yaml").read_text())
    assert info["sequences"]["00"] == {
        "colour": COLOUR,
        "depth": DEPTH,
        "colour_info": "/camera/color/camera_info",
    }


@pytest.mark.parametrize("name", WRITERS)
def test_the_article_s_layout_names_files_by_the_stamp(tmp_path: Path, name: str) -> None:
    bag = WRITERS[name](tmp_path / name, recording())
    found = import_bag(bag, tmp_path / "out", "article")
    for k in range(FRAMES):
        rgb = tmp_path / f"out/rgb/{START + k * STEP}.png"
        np.testing.assert_array_equal(read_rgb(rgb), colour(k))
        image = tmp_path / f"out/depth/{START + k * STEP + 1000}.png"
        np.testing.assert_array_equal(read_grey(image), depth(k))
    assert len(tree(tmp_path / "out")) == 2 * FRAMES + 2
    head, *rows = (tmp_path / "out/imu_odom.csv").read_text().splitlines()
    assert head.startswith("timestamp,topic,ax,ay,az,wx,wy,wz,pos_x,pos_y,pos_z,ori_x,ori_y,ori_z")
    assert sorted(rows)[:2] == [
        f"{START},/imu/data,0.0,2.0,3.0,4.0,5.0,,,,,,,,",
        f"{START},/odom,,,,,,,0.0,2.0,3.0,0.0,0.0,0.0,1.0",
    ]
    assert set(found.left_out) == {"/camera/color/camera_info", "/joint_states", "/ft", "/chatter"}


def test_a_storage_file_alone_is_a_bag_whatever_it_is_called(tmp_path: Path) -> None:
    for name, suffix in (("b_mcap", ".mcap"), ("b_sqlite3", ".db3")):
        folder = WRITERS[name](tmp_path / name, recording())
        bag = tmp_path / f"a %41#?\U0001f600{suffix}.txt"
        shutil.move(next(folder.glob(f"*{suffix}")), bag)
        import_bag(bag, tmp_path / f"out{suffix}", "sequences")
        assert len(list((tmp_path / f"out{suffix}/sequences/00/rgb").iterdir())) == FRAMES


def test_an_exported_bag_is_imported_with_the_values_of_the_store(tmp_path: Path) -> None:
    episode = Dataset(TINY)[0]
    Dataset(TINY).export("rosbag1", tmp_path / "bags", [0])
    import_bag(tmp_path / "bags/000000.bag", tmp_path / "out", "sequences")
    sequence = tmp_path / "out/sequences/00"
    for k, image in enumerate(episode.cameras["front"].rgb):
        np.testing.assert_array_equal(read_rgb(sequence / f"rgb/{k:06d}.png"), image)
    for k, metres in enumerate(episode.cameras["front"].depth):
        found = read_grey(sequence / f"depth/{k:06d}.png")
        np.testing.assert_allclose(found * 1e-3, metres, atol=5.001e-4)
    rows = read_csv(sequence / "imu/data.csv")
    found = np.array([[float(row[name]) for name in ("ax", "ay", "az")] for row in rows])
    np.testing.assert_array_equal(found, episode.imu["specific_force"])
    assert {row["qx"] for row in rows} == {""}


PATTERN = np.arange(4 * 6 * 4, dtype=np.uint8).reshape(4, 6, 4)
EXPECTED: dict[str, tuple[NDArray[Any], NDArray[Any]]] = {
    "rgb8": (PATTERN[..., :3], PATTERN[..., :3]),
    "bgr8": (PATTERN[..., :3], PATTERN[..., 2::-1]),
    "rgba8": (PATTERN, PATTERN[..., :3]),
    "bgra8": (PATTERN, PATTERN[..., 2::-1]),
    "8UC3": (PATTERN[..., :3], PATTERN[..., 2::-1]),
    "8UC4": (PATTERN, PATTERN[..., 2::-1]),
    "mono8": (PATTERN[..., 0], PATTERN[..., 0]),
    "8UC1": (PATTERN[..., 0], PATTERN[..., 0]),
    "mono16": (PATTERN[..., 0] * np.uint16(300), PATTERN[..., 0] * np.uint16(300)),
    "16UC1": (PATTERN[..., 0] * np.uint16(300), PATTERN[..., 0] * np.uint16(300)),
    "32FC1": (PATTERN[..., 0] * np.float32(0.1), PATTERN[..., 0] * np.uint16(100)),
}
ORDERS = {"rggb": "RGGB", "bggr": "BGGR", "gbrg": "GBRG", "grbg": "GRBG"}
PLAIN_COLOUR = {"R": 200, "G": 90, "B": 30}


def imported_image(tmp_path: Path, fields: dict[str, Any], kind: str = IMAGE) -> NDArray[Any]:
    """Return the image that the import of a bag with one message writes."""
    bag = bags.ros1(tmp_path / "b.bag", [("/image", kind, START, fields)])
    import_bag(bag, tmp_path / "out", "article")
    (file,) = (tmp_path / "out").glob("*/*.png")
    image = read_grey(file)
    return image if image.ndim == 2 else image[..., ::-1]


@pytest.mark.parametrize("encoding", EXPECTED)
@pytest.mark.parametrize(("padding", "big"), [(0, False), (5, True)])
def test_an_image_of_an_encoding_is_read_from_padded_rows_in_any_byte_order(
    tmp_path: Path, encoding: str, padding: int, big: bool
) -> None:
    stored, expected = EXPECTED[encoding]
    fields = bags.image(stored, encoding, padding=padding, big=big)
    np.testing.assert_array_equal(imported_image(tmp_path, fields), expected)


@pytest.mark.parametrize("pattern", ORDERS)
def test_a_bayer_pattern_of_one_colour_becomes_that_colour(tmp_path: Path, pattern: str) -> None:
    cell = np.array([PLAIN_COLOUR[c] for c in ORDERS[pattern]], np.uint8).reshape(2, 2)
    image = imported_image(tmp_path, bags.image(np.tile(cell, (4, 4)), f"bayer_{pattern}8"))
    assert {tuple(pixel) for pixel in image[2:-2, 2:-2].reshape(-1, 3)} == {(200, 90, 30)}


@pytest.mark.parametrize("encoding", ["yuv422", "uyvy", "yuv422_yuy2", "yuyv"])
def test_a_yuv_image_of_one_colour_becomes_that_colour(tmp_path: Path, encoding: str) -> None:
    pair = [128, 81, 128, 81] if encoding in ("yuv422", "uyvy") else [81, 128, 81, 128]
    rows = np.array(pair * 12, np.uint8).reshape(4, 6, 2)
    image = imported_image(tmp_path, bags.image(rows, encoding))
    assert np.ptp(image) == 0
    assert abs(int(image.flat[0]) - round((81 - 16) * 255 / 219)) <= 1


def test_every_encoding_has_a_test() -> None:
    tested = {*EXPECTED, *(f"bayer_{name}8" for name in ORDERS)}
    assert set(ENCODINGS) - tested == {"yuv422", "uyvy", "yuv422_yuy2", "yuyv"}


def encoded(suffix: str, image: NDArray[Any]) -> NDArray[np.uint8]:
    _, data = cv2.imencode(suffix, image)
    return data.ravel()


def test_compressed_images_are_decoded(tmp_path: Path) -> None:
    bgr = np.ascontiguousarray(PATTERN[..., :3])
    png = {"format": "bgr8; png compressed bgr8", "data": encoded(".png", bgr)}
    (tmp_path / "png").mkdir()
    np.testing.assert_array_equal(imported_image(tmp_path / "png", png, COMPRESSED), bgr[..., ::-1])
    flat = np.full((16, 16, 3), (30, 90, 200), np.uint8)
    jpeg = {"format": "jpeg", "data": encoded(".jpg", flat)}
    (tmp_path / "jpeg").mkdir()
    found = imported_image(tmp_path / "jpeg", jpeg, COMPRESSED).astype(int)
    assert np.abs(found - (200, 90, 30)).max() <= 2


@pytest.mark.parametrize("kind", ["16UC1; compressedDepth png", "16UC1; png compressed "])
def test_compressed_depth_is_decoded(tmp_path: Path, kind: str) -> None:
    values = PATTERN[..., 0] * np.uint16(300)
    head = bytes(12) if "compressedDepth" in kind else b""
    data = np.frombuffer(head + encoded(".png", values).tobytes(), np.uint8)
    image = imported_image(tmp_path, {"format": kind, "data": data}, COMPRESSED)
    np.testing.assert_array_equal(image, values)
    assert (tmp_path / "out/depth").is_dir()


def test_quantized_inverse_depth_becomes_millimetres(tmp_path: Path) -> None:
    a, b = 1000.0, -1.5
    values = PATTERN[..., 0].astype(np.uint16)
    data = struct.pack("<iff", 0, a, b) + encoded(".png", values).tobytes()
    fields = {"format": "32FC1; compressedDepth", "data": np.frombuffer(data, np.uint8)}
    image = imported_image(tmp_path, fields, COMPRESSED)
    metres = np.where(values > 0, a / (values - b), 0.0)
    expected = np.where(metres <= 65.535, np.rint(metres * 1000), 0)
    np.testing.assert_array_equal(image, expected)
    assert (expected > 0).any()


def test_stamps_that_do_not_ascend_are_sorted(tmp_path: Path) -> None:
    order = (3, 1, 0, 2)
    contents: list[Content] = []
    for arrival, k in enumerate(order):
        at = {"stamp": START + k * STEP}
        contents.append((COLOUR, IMAGE, START + arrival, bags.image(colour(k), "rgb8") | at))
        contents.append(("/imu", IMU, START + arrival, bags.imu((k, 0, 0), (0, 0, 0), **at)))
    bag = bags.mcap(tmp_path / "b", [(n, t, a, {**f}) for n, t, a, f in contents])
    import_bag(bag, tmp_path / "out", "sequences")
    sequence = tmp_path / "out/sequences/00"
    for k in range(4):
        np.testing.assert_array_equal(read_rgb(sequence / f"rgb/{k:06d}.png"), colour(k))
    assert len(list((sequence / "rgb").iterdir())) == 4
    rows = read_csv(sequence / "imu/data.csv")
    assert [float(row["ax"]) for row in rows] == [0, 1, 2, 3]


def test_messages_without_a_stamp_have_the_time_of_arrival_and_are_counted(tmp_path: Path) -> None:
    contents = [
        (COLOUR, IMAGE, START + k, bags.image(colour(k), "rgb8") | {"stamp": 0}) for k in (0, 1)
    ]
    found = import_bag(bags.ros1(tmp_path / "b.bag", contents), tmp_path / "out", "article")
    assert sorted(path.name for path in (tmp_path / "out/rgb").iterdir()) == [
        f"{START}.png",
        f"{START + 1}.png",
    ]
    assert [topic.without_stamp for topic in found.topics] == [2]


def test_images_of_the_same_stamp_have_names_of_their_own(tmp_path: Path) -> None:
    contents = [(COLOUR, IMAGE, START, bags.image(colour(k), "rgb8")) for k in range(3)]
    import_bag(bags.ros1(tmp_path / "b.bag", contents), tmp_path / "out", "article")
    for k, name in enumerate((f"{START}.png", f"{START}_1.png", f"{START}_2.png")):
        np.testing.assert_array_equal(read_rgb(tmp_path / "out/rgb" / name), colour(k))


def test_depth_goes_to_the_camera_whose_name_is_most_like_its_own(tmp_path: Path) -> None:
    image, deep = bags.image(colour(0), "rgb8"), bags.image(depth(0), "16UC1")
    small = {"format": "png", "data": encoded(".png", colour(1))}
    contents = [
        ("/left/depth/image", IMAGE, START, deep),
        ("/left/color/image/compressed", COMPRESSED, START, small),
        ("/left/infra/image", IMAGE, START, image),
        ("/left/color/camera_info", INFO, START, {}),
        ("/right/aligned/image", IMAGE, START, deep),
        ("/right/image", IMAGE, START, image),
        ("/lonely/camera_info", INFO, START, {}),
        ("/top/depth", IMAGE, START, deep),
        ("/imu/a", IMU, START, bags.imu((0, 0, 0), (0, 0, 0))),
        ("/imu/b", IMU, START, bags.imu((1, 0, 0), (0, 0, 0))),
    ]
    bag = bags.mcap(tmp_path / "b", contents)
    found = import_bag(bag, tmp_path / "out", "sequences")
    info = yaml.safe_load((tmp_path / "out/dataset_info.yaml").read_text())
    assert list(info["sequences"].values()) == [
        {
            "colour": "/left/color/image/compressed",
            "depth": "/left/depth/image",
            "colour_info": "/left/color/camera_info",
        },
        {"colour": "/left/infra/image"},
        {"colour": "/right/image", "depth": "/right/aligned/image"},
        {"depth": "/top/depth"},
    ]
    assert info["series"] == {"imu": "/imu/a", "imu_1": "/imu/b"}
    assert found.left_out == {"/lonely/camera_info": "no image topic is beside it"}
    for k in range(4):
        rows = read_csv(tmp_path / f"out/sequences/{k:02d}/imu_1/data.csv")
        assert [float(row["ax"]) for row in rows] == [1]
    (frame,) = json.loads((tmp_path / "out/sequences/03/metadata.json").read_text())
    assert (frame["rgb_path"], frame["depth_path"]) == ("", "depth/000000.png")


def test_depth_that_is_far_in_time_is_not_paired_but_there(tmp_path: Path) -> None:
    contents = [
        (COLOUR, IMAGE, START, bags.image(colour(0), "rgb8")),
        (DEPTH, IMAGE, START + 2 * STEP, bags.image(depth(0), "16UC1")),
    ]
    import_bag(bags.ros1(tmp_path / "b.bag", contents), tmp_path / "out", "sequences")
    (frame,) = json.loads((tmp_path / "out/sequences/00/metadata.json").read_text())
    assert frame["depth_path"] == ""
    (row,) = read_csv(tmp_path / "out/sequences/00/depth/data.csv")
    assert row["timestamp"].replace(".", "") == str(START + 2 * STEP)
    np.testing.assert_array_equal(
        read_grey(tmp_path / "out/sequences/00/depth" / row["file"]), depth(0)
    )


HOSTILE_NAMES = (
    "/../../../x",
    "..",
    "/a/../b",
    "a b\n\x1b[31m",
    "=1+1",
    "/\U0001f600/depth",
    "x" * 300,
)


def test_topics_of_any_name_stay_in_the_folder(tmp_path: Path) -> None:
    contents: list[Content] = []
    for name in HOSTILE_NAMES:
        contents.append((f"{name}", IMAGE, START, bags.image(colour(0), "rgb8")))
        contents.append((f"{name}/imu", IMU, START, bags.imu((0, 0, 0), (0, 0, 0))))
    (tmp_path / "inner").mkdir()
    bag = bags.ros1(tmp_path / "b.bag", contents)
    import_bag(bag, tmp_path / "inner/out", "sequences")
    names = [f"{k:02d}" for k in range(len(HOSTILE_NAMES))]
    assert sorted(p.name for p in (tmp_path / "inner/out/sequences").iterdir()) == names
    import_bag(bag, tmp_path / "inner/imu", "article", [f"{name}/imu" for name in HOSTILE_NAMES])
    text = (tmp_path / "inner/imu/imu_odom.csv").read_text()
    assert "\x1b" not in text
    assert f"{START},'=1+1/imu," in text
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.bag", "inner"]
    assert sorted(path.name for path in (tmp_path / "inner").iterdir()) == ["imu", "out"]


def test_messages_that_cannot_be_decoded_are_counted_with_the_first_reason(tmp_path: Path) -> None:
    short = bags.image(colour(1), "rgb8") | {"data": np.zeros(5, np.uint8)}
    contents = [
        (COLOUR, IMAGE, START, bags.image(colour(0), "rgb8")),
        (COLOUR, IMAGE, START + 1, short),
        (COLOUR, IMAGE, START + 2, bags.image(colour(2), "rgb9")),
        (COLOUR, IMAGE, START + 3, bags.image(depth(2), "16UC1")),
        (COLOUR, IMAGE, START + 4, bags.image(colour(2), "rgb8") | {"height": 2**31, "step": 0}),
        ("/chatter", "std_msgs/msg/String", START, {"data": "hello"}),
    ]
    bag = bags.mcap(tmp_path / "b", contents)
    (topic,) = import_bag(bag, tmp_path / "out", "sequences").topics
    assert (topic.imported, topic.undecodable) == (1, 4)
    assert topic.reason == "5 bytes, where 6 rows of 24 should be"
    record = json.loads((tmp_path / "out/grasp_factory_import.json").read_text())
    assert record["topics"][0]["undecodable"] == 4


def odd_bag(path: Path, definition: str, kind: str = "sensor_msgs/msg/Imu") -> Path:
    """Write a bag of ROS 1 whose own definition of a type has other fields."""
    types = get_typestore(Stores.EMPTY)
    types.register(get_types_from_msg(definition, kind))
    with Writer(path) as writer:
        connection = writer.add_connection("/odd", kind, typestore=types)
        data = types.serialize_ros1(types.types[kind](x=3), kind)
        writer.write(connection, START, data)
    return path


def garbled(path: Path) -> Path:
    """Write a bag with messages whose bytes are no images."""
    types = bags.ros1_types()
    with Writer(path) as writer:
        image = writer.add_connection("/image", IMAGE, typestore=types)
        imu = writer.add_connection("/imu", IMU, typestore=types)
        for k in range(3):
            writer.write(image, START + k, b"\xff" * 40)
            writer.write(imu, START + k, b"nonsense")
    return path


def linked(path: Path) -> Path:
    folder = bags.mcap(path, recording())
    (file,) = folder.glob("*.mcap")
    file.rename(folder.parent / "elsewhere")
    file.symlink_to(folder.parent / "elsewhere")
    return folder


def without_metadata(path: Path) -> Path:
    folder = bags.sqlite3(path, recording())
    (folder / "metadata.yaml").unlink()
    return folder


def named_by_a_uri(path: Path) -> Path:
    folder = bags.sqlite3(path, recording())
    (folder / "a%2e.db3").write_bytes(b"")
    return folder


def written(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def cut(path: Path) -> Path:
    data = bags.ros1(path.with_name("whole"), recording()).read_bytes()
    path.with_name("whole").unlink()
    return written(path, data[: len(data) // 2])


NO_BAG: dict[str, tuple[Callable[[Path], Path], str]] = {
    "nothing": (
        lambda path: path,
        "b does not exist; valid: a bag of ROS 1 or ROS 2, or an export",
    ),
    "an empty file": (
        lambda path: written(path, b""),
        "b is no ROS bag and no export: it begins with b''",
    ),
    "another file": (lambda path: written(path, b"\x89PNG\r\n"), "is no ROS bag"),
    "a device": (lambda path: Path("/dev/null"), "/dev/null is no regular file"),
    "a folder without metadata": (without_metadata, "b has no metadata.yaml"),
    "a folder with a link": (linked, "is a link, a folder or no regular file: remove it"),
    "a name that SQLite takes for a URI": (named_by_a_uri, "a%2e.db3: got a name with one of"),
    "a bag without topics": (lambda path: bags.ros1(path, []), "has no messages to import"),
    "other types only": (
        lambda path: bags.ros1(path, [("/s", "std_msgs/msg/String", START, {})]),
        "has no place in the layout); valid types: sensor_msgs/msg/Image,",
    ),
    "a type of its own": (lambda path: odd_bag(path, "int32 x"), "has no messages to import"),
    "bytes that are no messages": (garbled, "has no messages to import"),
}
DAMAGED: dict[str, Callable[[Path], Path]] = {
    "a cut bag": cut,
    "a head of ROS 1": lambda path: written(path, b"#ROSBAG V2.0\n"),
    "a head of MCAP": lambda path: written(path, b"\x89MCAP0\r\n"),
    "a head of SQLite": lambda path: written(path, b"SQLite format 3\0" + bytes(100)),
    "a record of a huge size": lambda path: written(path, b"#ROSBAG V2.0\n" + b"\xff" * 64),
    "an MCAP record of a huge size": lambda path: written(
        path, b"\x89MCAP0\r\n\x01" + b"\xff" * 7 + b"\x7f" + bytes(40) + b"\x89MCAP0\r\n"
    ),
}


@pytest.mark.parametrize("what", NO_BAG)
def test_what_is_no_bag_is_the_user_s_mistake_and_nothing_is_left(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    make, message = NO_BAG[what]
    bag = make(tmp_path / "b")
    before = sorted(tmp_path.iterdir())
    code, out, err = run("import", bag, tmp_path / "out", "--to", "sequences")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("what", DAMAGED)
def test_a_damaged_bag_is_one_line_and_nothing_is_left(run: Run, tmp_path: Path, what: str) -> None:
    bag = DAMAGED[what](tmp_path / "b")
    for words in (("--list",), (tmp_path / "out", "--to", "article")):
        code, out, err = run("import", bag, *words)
        assert (code, out, err.count("\n")) == (1, "", 1)
        assert f"{bag} cannot be read: " in err
        assert ".importing-" not in err
        assert list(tmp_path.iterdir()) == [bag]


def test_a_message_of_another_topic_than_the_index_says_is_one_line(
    run: Run, tmp_path: Path
) -> None:
    pixels = np.zeros((4, 4, 3), np.uint8)
    colour = bags.image(pixels, "rgb8")
    depth = bags.image(pixels[..., 0].astype(np.uint16), "16UC1")
    contents = [("/colour", bags.IMAGE, START, colour), ("/depth", bags.IMAGE, START, depth)]
    bag = bags.ros1(tmp_path / "b", contents)
    first, second = (b"op=\x02\t\0\0\0conn=%c\0\0\0" % number for number in (0, 1))
    assert bag.read_bytes().count(first) == 1
    bag.write_bytes(bag.read_bytes().replace(first, second))
    words = ("--to", "article", "--topics", "/colour")
    code, out, err = run("import", bag, tmp_path / "out", *words)
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert "b is damaged: a topic has messages of '/depth'" in err
    assert list(tmp_path.iterdir()) == [bag]


def test_a_cut_mcap_file_says_how_to_make_it_whole(run: Run, tmp_path: Path) -> None:
    bag = written(tmp_path / "b.mcap", b"\x89MCAP0\r\n" + bytes(100))
    code, _, err = run("import", bag, "--list")
    assert (code, err.count("\n")) == (1, 1)
    assert "it has no end, as after a recorder was killed; make it whole with `mcap recover`" in err


@pytest.mark.parametrize("name", WRITERS)
def test_a_bag_that_is_cut_anywhere_gives_one_error_or_all_of_a_part(
    tmp_path: Path, name: str
) -> None:
    bag = WRITERS[name](tmp_path / name, recording()[:16])
    file = bag if bag.is_file() else next(path for path in bag.iterdir() if path.suffix != ".yaml")
    data = file.read_bytes()
    for k in range(1, 12):
        file.write_bytes(data[: len(data) * k // 12])
        try:
            import_bag(bag, tmp_path / "out", "sequences")
        except (StoreError, UsageError):
            assert not (tmp_path / "out").exists()
        else:
            shutil.rmtree(tmp_path / "out")
        assert list(tmp_path.iterdir()) == [bag]


def test_a_topic_that_is_not_there_is_named_with_those_that_are(tmp_path: Path) -> None:
    bag = bags.ros1(tmp_path / "b.bag", recording())
    with pytest.raises(
        UnknownNameError, match="unknown topic '/imu/dat'; did you mean '/imu/data'"
    ):
        import_bag(bag, tmp_path / "out", "sequences", ["/imu/dat"])


def test_a_topic_that_was_asked_for_but_cannot_be_imported_is_refused(tmp_path: Path) -> None:
    bag = bags.ros1(tmp_path / "b.bag", recording())
    with pytest.raises(UsageError, match="the topic /chatter cannot be imported: std_msgs"):
        import_bag(bag, tmp_path / "out", "sequences", ["/chatter"])
    with pytest.raises(UsageError, match=r"/ft cannot be imported: geometry_msgs.* no place"):
        import_bag(bag, tmp_path / "out", "article", ["/ft"])


def test_several_colour_topics_do_not_fit_the_article_s_layout(tmp_path: Path) -> None:
    contents = [(name, IMAGE, START, bags.image(colour(0), "rgb8")) for name in ("/a", "/b")]
    bag = bags.ros1(tmp_path / "b.bag", contents)
    with pytest.raises(UsageError, match=r"one topic of colour images, got /a, /b: choose with"):
        import_bag(bag, tmp_path / "out", "article")
    assert import_bag(bag, tmp_path / "out", "article", ["/b"]).topics[0].name == "/b"


@pytest.mark.parametrize("layout", ["sequences", "article"])
@pytest.mark.parametrize("error", [errno.ENOSPC, errno.EIO])
def test_a_disk_that_fails_at_any_call_leaves_nothing(
    tmp_path: Path, layout: str, error: int
) -> None:
    second = ("/wrist/image_raw", IMAGE, START, {"stamp": START} | bags.image(colour(0), "rgb8"))
    cameras = [second] if layout == "sequences" else []
    bag = bags.ros1(tmp_path / "b.bag", [*recording()[:16], *cameras])
    folder = tmp_path / "exports"
    folder.mkdir()
    for failures in (0, 1, *(2**k for k in range(1, 12))):
        calls = iter(range(failures))
        first = lambda _done, calls=calls: next(calls, None) is None  # noqa: E731
        with FaultyDisk(folder, first, error, stays=False).installed() as disk:
            try:
                import_bag(bag, folder / "out", layout)
            except StoreError as caught:
                assert str(caught) == f"{folder / 'out'} cannot be written: {os.strerror(error)}"
            else:
                break
        assert disk.has_failed
        assert list(folder.iterdir()) == []
    assert failures > 2


def test_what_is_there_is_not_overwritten(tmp_path: Path) -> None:
    bag = bags.ros1(tmp_path / "b.bag", recording())
    (tmp_path / "out").write_text("mine")
    with pytest.raises(UsageError, match="exists, and an import overwrites nothing"):
        import_bag(bag, tmp_path / "out", "article")
    assert (tmp_path / "out").read_text() == "mine"


def test_the_list_has_count_rate_and_longest_gap(run: Run, tmp_path: Path) -> None:
    times = (0, 1, 2, 5, 6)
    contents = [("/imu", IMU, START + k * STEP, bags.imu((0, 0, 0), (0, 0, 0))) for k in times]
    contents.append(("/once", "std_msgs/msg/String", START, {}))
    bag = bags.sqlite3(tmp_path / "b", contents)
    assert run("import", bag, "--list") == (
        0,
        "/imu: sensor_msgs/msg/Imu, 5 messages, 6.66667 Hz, longest gap 0.3 s\n"
        "/once: std_msgs/msg/String, 1 message, -, longest gap -\n",
        "",
    )
    code, out, _ = run("import", bag, "--list", "--json")
    assert code == 0
    found = json.loads(out)
    assert found["without_topic"] == 0
    imu, once = found["topics"]
    assert (imu["name"], imu["count"]) == ("/imu", 5)
    assert imu["rate_hz"] == pytest.approx(4 / 0.6)
    assert imu["longest_gap_s"] == pytest.approx(0.3)
    assert (once["rate_hz"], once["longest_gap_s"]) == (None, None)


def test_the_command_says_what_became_of_each_topic(run: Run, tmp_path: Path) -> None:
    bag = bags.ros1(tmp_path / "b.bag", recording())
    words = ("import", bag, tmp_path / "out", "--to", "article")
    code, out, err = run(*words, "--topics", f"/imu/data,{COLOUR}", "--topics", "/odom")
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        f"{tmp_path}/out: 15 messages of 3 topics as article",
        f"{COLOUR}: 5 messages",
        "/imu/data: 5 messages",
        "/odom: 5 messages",
    ]
    assert run("import", bag)[0] == 2
    assert run("import", bag, tmp_path / "more", "--to", "articles")[0] == 2


@pytest.mark.usefixtures("isolated")
def test_a_bag_that_expands_to_more_than_the_memory_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "import-memory=100MiB")
    types = bags.ros2_types()
    writer = Writer2(tmp_path / "b", version=8, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/image", IMAGE, typestore=types)
        writer.write(connection, START, bytes(400 * 2**20))
    with pytest.raises(LimitError, match=r"the import needs more than 104.* trust this file"):
        import_bag(tmp_path / "b", tmp_path / "out", "sequences")
    assert [path.name for path in tmp_path.iterdir()] == ["b"]


@pytest.mark.usefixtures("isolated")
def test_a_decoder_that_crashes_ends_its_worker_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = bags.ros1(tmp_path / "b.bag", recording()[:16])
    assert isinstance(import_process.reading_executor(), LimitedExecutor)
    assert len(list_topics(bag).topics) == 8
    monkeypatch.setattr(importing, "extract", bags.end_the_process)
    with pytest.raises(StoreError, match=r"b.bag: reading it ended its process \(SIGKILL\)"):
        import_bag(bag, tmp_path / "out", "sequences")
    assert list(tmp_path.iterdir()) == [bag]
