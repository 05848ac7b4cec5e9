"""The page's addresses: what they answer is what the stores hold, quickly and from any thread."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from http.client import HTTPConnection, HTTPException
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from flask.testing import FlaskClient
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from support.browse_process import Running, browsing
from support.fake_episodes import JOINTS, make_episode, make_rows, small_config
from support.places import TINY
from support.replaced_block import replace_block
from support.scale import scaled

from grasp_factory.apps.browse import query_limit, serving, site
from grasp_factory.apps.browse.app import create_app
from grasp_factory.apps.browse.image_files import THUMB_WIDTH, video_frame
from grasp_factory.apps.browse.numbers import DIGITS, json_bytes, plain, rounded
from grasp_factory.apps.browse.points import MOST_POINTS, cloud_bytes
from grasp_factory.apps.browse.thumbnail_cache import Thumbnails
from grasp_factory.apps.pictures.painting import label_palette
from grasp_factory.core.enums import Label
from grasp_factory.core.serialization import to_plain
from grasp_factory.dataset.annotations import AnnotationLog
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.index import Index, Query, database, fresh
from grasp_factory.errors import StoreError, UsageError
from grasp_factory.robots import ROBOTS
from grasp_factory.signals.point_cloud import PointCloud
from grasp_factory.signals.touch import contact_values
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr.store import prepare_store

pytestmark = pytest.mark.slow

CONFIG = small_config(video_hz=10)
N, QUARANTINED = 14, 5
MISSING = range(8, 12)
"""Block 2 is not made yet."""
ROBOT = {"robot": ROBOTS[CONFIG.robot].facts()}
TOKEN = "the token"
REAL, FAKE = 0, 1
"""Numbers of the stores."""


def make_fake(path: Path, n: int = N, blocks: tuple[int, ...] = (0, 1, 3)) -> Path:
    prepare_store(path, CONFIG, JOINTS, n, ROBOT)
    for block in blocks:
        ZarrWriter(path).write_block(block, make_rows(CONFIG, block, n, (QUARANTINED,)))
    return path


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return a store of real attempts, and one with a quarantined row, a missing block, videos."""
    folder = tmp_path_factory.mktemp("stores")
    return Path(shutil.copytree(TINY, folder / "real.zarr")), make_fake(folder / "fake.zarr")


@contextlib.contextmanager
def page_of(
    folder: Path, *stores: Path, token: str = TOKEN, thumbnails: Thumbnails | None = None
) -> Iterator[FlaskClient]:
    """Give a client of the page over some stores; index and thumbnails are in ``folder``."""
    with fresh(stores, folder / "index.sqlite") as index:
        kept = thumbnails or Thumbnails(folder / "thumbnails")
        with create_app(index, token, {"localhost"}, thumbnails=kept).test_client() as client:
            yield client


@pytest.fixture(scope="module")
def page(
    stores: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[FlaskClient]:
    with page_of(tmp_path_factory.mktemp("page"), *stores) as client:
        yield client


@pytest.fixture
def own_store(stores: tuple[Path, Path], tmp_path: Path) -> Path:
    """Return a copy of the second store that the test may change."""
    return Path(shutil.copytree(stores[FAKE], tmp_path / "own.zarr"))


@pytest.fixture(scope="module")
def real(stores: tuple[Path, Path]) -> Dataset:
    return Dataset(stores[REAL])


@pytest.fixture(scope="module")
def fake(stores: tuple[Path, Path]) -> Dataset:
    return Dataset(stores[FAKE])


@pytest.fixture
def always_looking(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the server look for changes at every request."""
    monkeypatch.setattr(site, "LOOK_AGAIN_S", 0.0)


def get(client: FlaskClient, address: str, code: int = 200, **more: Any) -> Any:
    """Return the JSON that an address answers."""
    answer = client.get(address, **more)
    assert answer.status_code == code, answer.data
    assert answer.content_type == "application/json"
    return json.loads(answer.data)


def get_bytes(client: FlaskClient, address: str, kind: str) -> bytes:
    answer = client.get(address)
    assert (answer.status_code, answer.content_type) == (200, kind), answer.data
    data = bytes(answer.data)
    answer.close()
    return data


def get_image(client: FlaskClient, address: str, kind: str = "image/png") -> Any:
    """Return the image (H, W, 3) that an address answers, RGB."""
    data = np.frombuffer(get_bytes(client, address, kind), np.uint8)
    image = cv2.imdecode(data, cv2.IMREAD_COLOR)
    assert image is not None
    return image[..., ::-1]


def post(client: FlaskClient, body: Any, code: int = 200) -> Any:
    answer = client.post("/api/annotations", json=body, headers={"X-Token": TOKEN})
    assert answer.status_code == code, answer.data
    return json.loads(answer.data)


def close(values: Any, want: Any) -> bool:
    """Say whether a rounded answer is what was stored, None standing for NaN."""
    got = np.array(values, np.float64)
    return bool(np.allclose(got, want, rtol=10.0 ** (1 - DIGITS), atol=0.0, equal_nan=True))


class TestNumbers:
    @given(values=npst.arrays(np.float64, npst.array_shapes(max_dims=3, max_side=5)))
    def test_rounding_keeps_six_digits_and_turns_what_is_no_number_into_none(
        self, values: np.ndarray
    ) -> None:
        listed = rounded(values)
        json.dumps(listed, allow_nan=False)
        got = np.array(listed, np.float64).reshape(values.shape)
        finite = np.isfinite(values)
        assert np.isnan(got[~finite]).all()
        normal = finite & (np.abs(values) > 1e-290)
        assert np.allclose(got[normal], values[normal], rtol=0.51 * 10.0 ** (1 - DIGITS), atol=0.0)

    @given(value=st.floats(1e-9, 1e9))
    def test_a_rounded_number_is_written_with_six_digits(self, value: float) -> None:
        text = json.dumps(rounded([value])[0])
        digits = text.partition("e")[0].replace(".", "").strip("0")
        assert len(digits) <= DIGITS

    @settings(max_examples=scaled(30, 100))
    @given(
        value=st.recursive(
            st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
            lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
        )
    )
    def test_whatever_there_is_becomes_strict_ascii_json(self, value: Any) -> None:
        found = json.loads(json_bytes(value).decode("ascii"))
        assert found == plain(value)

    def test_numpy_s_values_are_plain(self) -> None:
        value = {"a": np.float32(0.5), "b": np.array([1.0, np.nan]), "c": np.array(["x", "y"])}
        assert plain(value) == {"a": 0.5, "b": [1.0, None], "c": ["x", "y"]}


class TestTheGrid:
    def test_the_library_says_what_stores_there_are(
        self, page: FlaskClient, stores: tuple[Path, Path]
    ) -> None:
        library = get(page, "/api/library")
        first, second = library["stores"]
        assert (first["name"], first["path"]) == ("real.zarr", str(stores[REAL]))
        assert (first["episodes"], first["committed"], first["video"]) == (4, 4, False)
        assert (second["episodes"], second["committed"], second["video"]) == (N, 9, True)
        assert second["resolution"] == [32, 24]
        assert second["cameras"] == list(CONFIG.cameras)
        assert library["writable"] is True
        assert library["trouble"] == ""
        assert "success" in library["outcomes"]
        kinds = {column["name"]: column for column in library["columns"]}
        assert kinds["lift_height"]["units"] == "m"
        assert kinds["lift_height"]["shown"] == {"unit": "mm", "factor": 1000.0, "decimals": 1}
        assert set(kinds["policy"]["words"]) >= {"uniform"}

    def test_the_labels_have_the_colours_of_the_pictures(self, page: FlaskClient) -> None:
        labels = get(page, "/api/library")["labels"]
        palette = label_palette()[:, ::-1]
        for label in labels:
            assert bytes.fromhex(label["color"][1:]) == palette[label["value"]].tobytes()
        assert labels[Label.TARGET]["name"] == "target"

    def test_the_page_is_there_with_all_its_files(self, page: FlaskClient) -> None:
        assert b"<script" in get_bytes(page, "/", "text/html; charset=utf-8")
        folder = Path(serving.__file__).parent / "static"
        files = [p for p in folder.rglob("*") if p.suffix in (".js", ".css", ".svg")]
        assert len(files) > 5
        for file in files:
            answer = page.get(f"/static/{file.relative_to(folder).as_posix()}")
            assert answer.data == file.read_bytes()
            answer.close()

    def test_pages_of_rows_follow_one_another(self, page: FlaskClient) -> None:
        whole = get(page, "/api/episodes?sort=-row")
        first, second = (get(page, f"/api/episodes?sort=-row&offset={k}&limit=6") for k in (0, 6))
        assert whole["total"] == first["total"] == 4 + N - len(MISSING)
        assert whole["rows"][:12] == first["rows"] + second["rows"]

    def test_conditions_choose_rows(self, page: FlaskClient) -> None:
        where = "where=store%3D1&where=status%3Dquarantined"
        found = get(page, f"/api/episodes?{where}")
        assert [(row["store"], row["row"]) for row in found["rows"]] == [(FAKE, QUARANTINED)]
        assert get(page, f"/api/ids?{where}") == {"ids": [f"{FAKE}:{QUARANTINED}"]}

    def test_histograms_count_every_row(self, page: FlaskClient) -> None:
        words = get(page, "/api/histogram?column=outcome&where=status%3Dcommitted")
        assert words["kind"] == "words"
        assert sum(bar["count"] for bar in words["bars"]) == 13
        numbers = get(page, "/api/histogram?column=lift_height&bins=7&where=status%3Dcommitted")
        assert (numbers["kind"], numbers["units"]) == ("numbers", "m")
        assert len(numbers["edges"]) == len(numbers["counts"]) + 1 == 8
        assert sum(numbers["counts"]) + numbers["missing"] == 13

    def test_neighbours_are_those_of_the_same_query(self, page: FlaskClient) -> None:
        found = get(page, "/api/neighbours/0/2?where=store%3D0&sort=-row")
        assert found == {"position": 1, "total": 4, "previous": [0, 3], "next": [0, 1]}
        outside = get(page, "/api/neighbours/1/2?where=store%3D0")
        assert outside == {"position": None, "total": 4, "previous": None, "next": None}

    @pytest.mark.parametrize(
        ("address", "said"),
        [
            ("/api/episodes?where=polcy%3Duniform", "did you mean 'policy'"),
            ("/api/episodes?where=row%3Dx", "a number"),
            ("/api/episodes?sort=nope", "unknown column"),
            ("/api/episodes?limit=501", "valid: 0 to 500"),
            ("/api/episodes?offset=-1", "valid: 0 to"),
            ("/api/episodes?offset=1e3", "valid: 0 to"),
            ("/api/histogram?column=nope", "unknown column"),
            ("/api/histogram?column=row&bins=0", "valid: 1 to 200"),
            ("/api/ids?where=", "valid: COLUMN=VALUE"),
            ("/api/ids?" + "&where=row%3D1" * 21, "got 21 conditions, valid: up to 20"),
        ],
    )
    def test_a_mistake_is_told_in_words(self, page: FlaskClient, address: str, said: str) -> None:
        assert said in get(page, address, 400)["error"]


class TestOneEpisode:
    def test_its_columns_are_the_store_s(self, page: FlaskClient, fake: Dataset) -> None:
        columns = get(page, "/api/episode/1/2")["columns"]
        assert set(columns) >= {"outcome", "lift_height", "grasp_position", "object_rest_pose"}
        for name, value in columns.items():
            assert value == plain(fake.value(2, name)), name

    def test_its_cameras_are_those_of_the_recipe(self, page: FlaskClient, real: Dataset) -> None:
        found = get(page, "/api/episode/0/1")
        for name, camera in found["cameras"].items():
            for frame in (0, 1):
                K, T = real.calibration(1, name, frame)
                assert np.allclose(camera["intrinsics"], K)
                assert np.allclose(camera["T_world_camera"][frame], T)
            near, far = found["depth_range"][name]
            assert camera["near"] <= near < far <= camera["far"]
        assert found["spec"] == to_plain(real.spec(1))
        assert found["pad_size"] == ROBOTS[real.config.robot].facts()["pad_size"]
        assert found["objects"] == real.value(1, "object_ids").tolist()

    def test_a_quarantined_one_has_its_reason_and_its_recipe(
        self, page: FlaskClient, fake: Dataset
    ) -> None:
        found = get(page, f"/api/episode/{FAKE}/{QUARANTINED}")
        assert (found["status"], found["error"]) == ("quarantined", f"no luck with {QUARANTINED}")
        assert found["spec"] == to_plain(fake.spec(QUARANTINED))
        assert "columns" not in found

    @pytest.mark.parametrize("row", [MISSING[0], QUARANTINED, N, 999_999_999])
    def test_what_has_no_episode_has_no_images_and_series(
        self, page: FlaskClient, row: int
    ) -> None:
        for address in (
            *(f"/api/series/1/{row}", f"/api/tactile/1/{row}", f"/thumb/1/{row}.jpg"),
            *(
                f"/image/1/{row}/front/rgb/0.png",
                f"/cloud/1/{row}/0",
                f"/video/1/{row}/front/0.jpg",
            ),
        ):
            assert str(row) in get(page, address, 404)["error"]
        if row != QUARANTINED:
            get(page, f"/api/episode/1/{row}", 404)

    def test_a_store_that_there_is_not_is_not_found(self, page: FlaskClient) -> None:
        for address in ("/api/episode/2/0", "/thumb/999999999/0.jpg", "/api/neighbours/7/0"):
            assert "no store" in get(page, address, 404)["error"]

    def test_its_series_are_the_store_s(self, page: FlaskClient, real: Dataset) -> None:
        found, episode = get(page, "/api/series/0/0"), real[0]
        streams = episode.streams
        assert close(found["time"], streams["timestamp"])
        assert close(found["imu_time"], episode.imu["timestamp"])
        groups = {group["key"]: group for group in found["groups"]}
        for key in ("joint_positions", "joint_velocities", "joint_torques"):
            values = [series["values"] for series in groups[key]["series"]]
            assert close(values, streams[key].T)
        force = [series["values"] for series in groups["imu_specific_force"]["series"]]
        assert close(force, episode.imu["specific_force"].T)
        assert close(found["poses"]["tcp"], streams["tcp_pose"])
        assert close(found["poses"]["objects"], np.swapaxes(streams["object_pose"], 0, 1))
        assert found["phases"][0]["start"] == pytest.approx(streams["timestamp"][0], rel=1e-6)
        assert found["phases"][-1]["end"] == pytest.approx(streams["timestamp"][-1], rel=1e-6)
        height = groups["object_height"]["series"][0]["values"]
        assert groups["object_height"]["units"] == "mm"
        assert max(height) >= 1e3 * real.value(0, "lift_height") - 1e-3

    def test_the_arm_s_links_end_where_the_tool_was_measured(
        self, page: FlaskClient, real: Dataset
    ) -> None:
        found = get(page, "/api/series/0/0")
        joints = real.attributes["robot"]["joint_names"]
        assert found["links"]["names"] == ["base", *joints, "tcp"]
        places = np.array(found["links"]["positions"])
        tcp = np.array(found["poses"]["tcp"])[:, :3]
        assert np.abs(places[:, -1] - tcp).max() < 1e-4
        lengths = np.linalg.norm(np.diff(places, axis=1), axis=2)
        assert np.ptp(lengths, axis=0).max() < 1e-4  # links do not stretch

    def test_a_series_with_gaps_has_null_there(self, page: FlaskClient, fake: Dataset) -> None:
        row = next(r for r in (0, 1, 2, 3, 4, 6, 7) if fake.value(r, "n_steps") > 5)
        want = fake.series(row, "joint_torques")["joint_torques"]
        assert np.isnan(want).any()
        groups = {group["key"]: group for group in get(page, f"/api/series/1/{row}")["groups"]}
        got = [series["values"] for series in groups["joint_torques"]["series"]]
        assert close(got, want.T)

    def test_touch_has_all_of_the_force(self, page: FlaskClient, real: Dataset) -> None:
        told = get(page, "/api/series/0/0")["tactile"]
        data = get_bytes(page, "/api/tactile/0/0", "application/octet-stream")
        image = np.frombuffer(data, "<f4").reshape(-1, 2, told["rows"], told["columns"])
        names = ("tactile_force", "tactile_normal")
        want = contact_values(real.series(0, *names)).sum(axis=2)
        assert np.allclose(image.sum(axis=(2, 3)), want, atol=1e-4)
        assert image.max() > 0.0
        assert image.max() == pytest.approx(told["max"], rel=1e-6)

    def test_an_attempt_without_records_has_empty_series(self, tmp_path: Path) -> None:
        path = tmp_path / "short.zarr"
        prepare_store(path, CONFIG, JOINTS, 4, ROBOT)
        rows = [make_episode(CONFIG, i, 0) for i in range(4)]
        ZarrWriter(path).write_block(0, rows)
        with page_of(tmp_path, path) as client:
            found = get(client, "/api/series/0/1")
            assert found["time"] == found["phases"] == found["poses"]["tcp"] == []
            assert get_bytes(client, "/api/tactile/0/1", "application/octet-stream") == b""
            assert get(client, "/api/episode/0/1")["columns"]["n_steps"] == 0


class TestPictures:
    @pytest.mark.parametrize("frame", [0, 1])
    def test_an_image_has_the_stored_pixels(
        self, page: FlaskClient, fake: Dataset, frame: int
    ) -> None:
        got = get_image(page, f"/image/1/2/front/rgb/{frame}.png")
        assert (got == fake.image(2, "front", "rgb", frame)).all()

    def test_a_segmentation_has_a_colour_for_each_label(
        self, page: FlaskClient, real: Dataset
    ) -> None:
        labels = real.image(0, "front", "segmentation", 1)
        got = get_image(page, "/image/0/0/front/segmentation/1.png")
        assert (got == label_palette()[labels][..., ::-1]).all()

    def test_an_overlay_tints_robot_and_objects_alone(
        self, page: FlaskClient, real: Dataset
    ) -> None:
        labels = real.image(0, "front", "segmentation", 0)
        rgb = real.image(0, "front", "rgb", 0)
        differs = (get_image(page, "/image/0/0/front/overlay/0.png") != rgb).any(axis=2)
        assert not differs[labels < Label.ARM].any()
        assert differs[labels == Label.TARGET].mean() > 0.9

    def test_a_depth_picture_is_dark_where_nothing_is_seen(
        self, page: FlaskClient, real: Dataset
    ) -> None:
        far = real.spec(0).cameras["front"].far
        nothing = real.image(0, "front", "depth", 0) >= far
        got = get_image(page, "/image/0/0/front/depth/0.png")
        assert len(np.unique(got[~nothing], axis=0)) > 20
        assert len(np.unique(got[nothing], axis=0)) <= 1

    def test_a_frame_of_a_video_is_the_stored_one(self, page: FlaskClient, fake: Dataset) -> None:
        row = next(r for r in (0, 1, 2, 3, 4, 6, 7) if fake.value(r, "n_video") > 2)
        count = int(fake.value(row, "n_video"))
        told = get(page, f"/api/episode/1/{row}")["cameras"]["front"]["video_frames"]
        assert told == count == len(get(page, f"/api/series/1/{row}")["video_time"])
        for frame, want in enumerate(fake[row].videos["front/rgb"]):
            got = get_bytes(page, f"/video/1/{row}/front/{frame}.jpg", "image/jpeg")
            assert got == video_frame(want)
        get(page, f"/video/1/{row}/front/{count}.jpg", 404)
        get(page, "/video/0/0/front/0.jpg", 404)  # that store has none

    @pytest.mark.parametrize(
        "address",
        [
            *("/image/0/0/nope/rgb/0.png", "/image/0/0/front/nope/0.png"),
            *("/image/0/0/front/rgb/2.png", "/thumb/0/0.jpg?camera=nope"),
            *("/cloud/0/0/2", "/cloud/0/0/0?camera=nope", "/video/0/0/nope/0.jpg"),
        ],
    )
    def test_a_picture_that_there_is_not_is_not_found(
        self, page: FlaskClient, address: str
    ) -> None:
        assert "there is no such" in get(page, address, 404)["error"]

    def test_a_thumbnail_is_small_and_kept(self, stores: tuple[Path, Path], tmp_path: Path) -> None:
        with page_of(tmp_path, stores[REAL]) as client:
            first = get_bytes(client, "/thumb/0/1.jpg?frame=1", "image/jpeg")
            (file,) = (tmp_path / "thumbnails").rglob("*.jpg")
            assert file.read_bytes() == first
            file.write_bytes(b"kept")
            assert get_bytes(client, "/thumb/0/1.jpg?frame=1", "image/jpeg") == b"kept"
            assert get_bytes(client, "/thumb/0/1.jpg", "image/jpeg") not in (first, b"kept")
        image = cv2.imdecode(np.frombuffer(first, np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        assert image.shape == (round(THUMB_WIDTH * 72 / 96), THUMB_WIDTH, 3)

    def test_thumbnails_are_shown_where_none_can_be_kept(
        self, stores: tuple[Path, Path], tmp_path: Path
    ) -> None:
        (tmp_path / "file").write_bytes(b"")
        nowhere = Thumbnails(tmp_path / "file" / "thumbnails")
        with page_of(tmp_path, stores[REAL], thumbnails=nowhere) as client:
            get_image(client, "/thumb/0/1.jpg", "image/jpeg")
        assert nowhere.prune() == 0

    def test_thumbnails_that_were_not_used_for_longest_go_first(self, tmp_path: Path) -> None:
        kept, now = Thumbnails(tmp_path), time.time()
        for key in "abcdef":
            kept.get(key, lambda: bytes(100))
        files = list(tmp_path.rglob("*.jpg"))
        for age, file in enumerate(files):
            os.utime(file, (now - 86400 * age,) * 2)
        assert kept.prune(450) == 2
        assert set(tmp_path.rglob("*.jpg")) == set(files[:4])

    def test_a_thumbnail_that_is_used_gets_a_new_date(self, tmp_path: Path) -> None:
        kept = Thumbnails(tmp_path)
        kept.get("a", lambda: b"picture")
        (file,) = tmp_path.rglob("*.jpg")
        os.utime(file, (0.0, 0.0))
        assert kept.get("a", lambda: b"another") == b"picture"
        assert time.time() - file.stat().st_mtime < 3600


class TestClouds:
    def parts(self, data: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        count = int(np.frombuffer(data, "<u4", 1)[0])
        assert len(data) == 4 + count * (12 + 3 + 1)
        points = np.frombuffer(data, "<f4", 3 * count, 4).reshape(-1, 3)
        rgb = np.frombuffer(data, np.uint8, 3 * count, 4 + 12 * count).reshape(-1, 3)
        return points, rgb, np.frombuffer(data, np.uint8, count, 4 + 15 * count)

    def test_a_cloud_is_the_store_s(self, page: FlaskClient, real: Dataset) -> None:
        want = real.point_cloud(0, "front", 1)
        for address in ("/cloud/0/0/1?camera=front", "/cloud/0/0/1"):
            points, rgb, labels = self.parts(get_bytes(page, address, "application/octet-stream"))
            here = {tuple(point): k for k, point in enumerate(want.points.astype(np.float32))}
            at = [here[tuple(point)] for point in points]
            assert (rgb == want.rgb[at]).all()
            assert (labels == want.labels[at]).all()
            assert (want.labels == Label.TARGET).sum() == (labels == Label.TARGET).sum() > 0

    @given(
        count=st.integers(0, 3) | st.integers(MOST_POINTS - 1, MOST_POINTS * 3),
        floor=st.sampled_from(["none", "half", "all"]),
    )
    def test_a_cloud_has_no_more_points_than_a_browser_turns_smoothly(
        self, count: int, floor: str
    ) -> None:
        rng = np.random.default_rng(count)
        labels = np.full(count, Label.TABLE, np.uint8)
        labels[: {"none": 0, "half": count // 2, "all": count}[floor]] = Label.FLOOR
        points = rng.uniform(-0.5, 0.5, (count, 3))
        whole = PointCloud(points=points, rgb=np.zeros((count, 3), np.uint8), labels=labels)
        got, _, _ = self.parts(cloud_bytes(whole))
        assert len(got) == min(count, MOST_POINTS)
        if count:
            assert (got[0] == points[0].astype(np.float32)).all()
            assert (got[-1] == points[-1].astype(np.float32)).all()

    def test_the_floor_far_away_is_left_out(self) -> None:
        points = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, -0.7], [9.0, 0.0, -0.7], [9.0, 9.0, 0.0]])
        labels = np.array([Label.TABLE, Label.FLOOR, Label.FLOOR, Label.TABLE], np.uint8)
        cloud = PointCloud(points=points[:3], rgb=np.zeros((3, 3), np.uint8), labels=labels[:3])
        assert len(self.parts(cloud_bytes(cloud))[0]) == 2
        cloud = PointCloud(points=points, rgb=np.zeros((4, 3), np.uint8), labels=labels)
        assert len(self.parts(cloud_bytes(cloud))[0]) == 4


class TestKeptAnswers:
    ADDRESSES = ("/thumb/0/1.jpg", "/image/0/1/front/rgb/0.png", "/api/series/0/1", "/cloud/0/1/0")

    @pytest.mark.parametrize("address", ADDRESSES)
    def test_what_the_browser_has_is_not_sent_again(self, page: FlaskClient, address: str) -> None:
        first = page.get(address)
        assert "no-cache" in first.headers["Cache-Control"]
        again = page.get(address, headers={"If-None-Match": first.headers["ETag"]})
        assert (again.status_code, again.data) == (304, b"")
        other = page.get(
            address.replace("/0/1", "/0/2"), headers={"If-None-Match": first.headers["ETag"]}
        )
        assert other.status_code == 200

    @pytest.mark.parametrize("address", ADDRESSES)
    def test_an_address_with_the_episode_s_version_is_good_for_a_year(
        self, page: FlaskClient, real: Dataset, address: str
    ) -> None:
        current = page.get("/api/episode/0/1").json["version"]
        for version, is_kept in ((current, True), ("", False), (current[:8], False),
                                 (str(real.value(1, "checksum"))[:16], False)):  # fmt: skip
            answer = page.get(address, query_string={"v": version})
            assert answer.status_code == 200
            assert ("max-age=31536000" in answer.headers["Cache-Control"]) is is_kept
            assert "private" in answer.headers["Cache-Control"]

    def test_an_episode_that_was_made_again_is_sent_again(
        self, own_store: Path, tmp_path: Path
    ) -> None:
        with page_of(tmp_path, own_store) as client:
            before = client.get("/image/0/1/front/rgb/0.png")
            seeded = small_config(video_hz=10, seed=CONFIG.seed + 1)
            rows = [make_episode(seeded, i) for i in range(4)]
            replace_block(own_store, 0, rows)
            tag = {"If-None-Match": before.headers["ETag"]}
            after = client.get("/image/0/1/front/rgb/0.png", headers=tag)
            assert after.status_code == 200
            assert after.data != before.data

    def test_what_is_asked_of_the_index_is_not_kept(self, page: FlaskClient) -> None:
        for address in ("/api/library", "/api/episodes", "/api/episode/0/1", "/api/live"):
            assert page.get(address).headers["Cache-Control"] == "no-store"


class TestStoresThatChange:
    def test_rows_that_a_run_adds_are_seen(
        self, own_store: Path, tmp_path: Path, always_looking: None
    ) -> None:
        with page_of(tmp_path, own_store) as client:
            before = get(client, "/api/episodes")["total"]
            get(client, f"/image/0/{MISSING[0]}/front/rgb/0.png", 404)
            ZarrWriter(own_store).write_block(2, make_rows(CONFIG, 2, N))
            assert get(client, "/api/episodes")["total"] == before + len(MISSING)
            get_image(client, f"/image/0/{MISSING[0]}/front/rgb/0.png")

    def test_a_row_that_was_made_a_moment_ago_can_be_opened(
        self, own_store: Path, tmp_path: Path
    ) -> None:
        """A card of the live page leads to it before anybody has looked at the stores again."""
        with page_of(tmp_path, own_store) as client:
            get(client, f"/api/episode/0/{MISSING[0]}", 404)
            get(client, f"/api/episode/0/{N}", 404)
            ZarrWriter(own_store).write_block(2, make_rows(CONFIG, 2, N, quarantined=(9,)))
            for row in (MISSING[0], 9):
                assert get(client, f"/api/episode/0/{row}")["index"]["row"] == row

    def test_a_store_that_grew_is_opened_again(
        self, own_store: Path, tmp_path: Path, always_looking: None
    ) -> None:
        with page_of(tmp_path, own_store) as client:
            assert get(client, "/api/library")["stores"][0]["episodes"] == N
            prepare_store(own_store, CONFIG, JOINTS, 20, ROBOT)
            ZarrWriter(own_store).write_block(4, make_rows(CONFIG, 4, 20))
            assert get(client, "/api/library")["stores"][0]["episodes"] == 20
            assert get(client, "/api/episodes?where=row%3D19")["total"] == 1
            get_image(client, "/thumb/0/19.jpg", "image/jpeg")

    def test_nobody_looks_at_the_stores_more_often_than_every_few_seconds(
        self, own_store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        looks = []
        refresh = Index.refresh
        monkeypatch.setattr(Index, "refresh", lambda self: (looks.append(1), refresh(self))[1])
        with page_of(tmp_path, own_store) as client:
            for _ in range(5):
                get(client, "/api/episodes")
            assert len(looks) == 1
            get(client, "/api/library")
            assert len(looks) == 2

    def test_a_store_that_has_gone_leaves_the_others(
        self, stores: tuple[Path, Path], own_store: Path, tmp_path: Path
    ) -> None:
        with page_of(tmp_path, own_store, stores[REAL]) as client:
            shutil.rmtree(own_store)
            library = get(client, "/api/library")
            assert str(own_store) in library["trouble"]
            assert str(own_store) in library["stores"][0]["error"]
            assert library["stores"][1]["error"] == ""
            assert get(client, "/api/episodes")["total"] == 4 + N - len(MISSING)
            get_image(client, "/thumb/1/0.jpg", "image/jpeg")
            assert str(own_store) in get(client, "/thumb/0/0.jpg", 400)["error"]

    def test_a_damaged_image_is_trouble_of_the_store(self, own_store: Path, tmp_path: Path) -> None:
        with page_of(tmp_path, own_store) as client:
            for file in (own_store / "cameras/front/rgb").glob("0.*"):
                file.write_bytes(b"damaged")
            error = get(client, "/image/0/1/front/rgb/0.png", 503)["error"]
            assert "cameras/front/rgb of episodes 1 to 1 cannot be read" in error
            get_image(client, "/image/0/4/front/rgb/0.png")

    @pytest.mark.parametrize(
        "address",
        ["/api/library", "/api/episodes", "/api/histogram?column=row", "/api/neighbours/0/1"],
    )
    def test_an_index_that_somebody_deleted_is_made_again(
        self, stores: tuple[Path, Path], tmp_path: Path, address: str
    ) -> None:
        with page_of(tmp_path, *stores) as client:
            before = get(client, address)
            (tmp_path / "index.sqlite").unlink()
            assert get(client, address) == before
            assert get(client, "/api/ids")["ids"][-1] == f"1:{N - 1}"

    def test_an_index_that_cannot_be_made_again_is_told(
        self, own_store: Path, tmp_path: Path
    ) -> None:
        with page_of(tmp_path, own_store) as client:
            (tmp_path / "index.sqlite").unlink()
            shutil.rmtree(own_store)
            assert str(own_store) in get(client, "/api/episodes", 400)["error"]

    def test_writing_to_an_index_that_has_gone_is_the_user_s_trouble(
        self, own_store: Path, tmp_path: Path
    ) -> None:
        with fresh([own_store], tmp_path / "index.sqlite") as index:
            index.path.unlink()
            with pytest.raises(UsageError, match="cannot be written"):
                index.annotated(0, {1: None})
            with pytest.raises(StoreError, match=r"grasp-factory index STORE... --out"):
                index.row(0, 1)

    def test_a_query_that_takes_too_long_is_stopped(
        self, stores: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(database, "_STEPS", 1)
        with fresh(stores, tmp_path / "index.sqlite") as index:
            index.patience_s = 0.0
            with pytest.raises(StoreError, match=r"the query takes too long: .* after 0 s"):
                index.page(Query.parse(["checksum!=x"], "-object_id"))
            index.patience_s = 60.0
            assert index.page(Query.parse(["checksum!=x"], "-object_id")).total == index.count(
                Query()
            )

    def test_who_asks_while_too_many_do_is_told_and_gets_pictures_still(
        self, stores: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        inside, free = threading.Semaphore(0), threading.Event()
        count = Index.page

        def slowly(index: Index, *asked: Any) -> Any:
            inside.release()
            assert free.wait(60)
            return count(index, *asked)

        monkeypatch.setattr(Index, "page", slowly)
        monkeypatch.setattr(query_limit, "WAIT_S", 0.05)
        with fresh([stores[REAL]], tmp_path / "index.sqlite") as index:
            app = create_app(index, "", {"localhost"}, thumbnails=Thumbnails(tmp_path))
            ask = lambda _: app.test_client().get("/api/episodes").status_code  # noqa: E731
            with ThreadPoolExecutor(query_limit.ASKING) as pool:
                asking = [pool.submit(ask, None) for _ in range(query_limit.ASKING)]
                try:
                    assert all(inside.acquire(timeout=60) for _ in asking)
                    assert "too many" in get(app.test_client(), "/api/ids", 503)["error"]
                    get_image(app.test_client(), "/thumb/0/0.jpg", "image/jpeg")
                finally:
                    free.set()
                assert {done.result() for done in asking} == {200}
            assert get(app.test_client(), "/api/ids")["ids"] == ["0:0", "0:1", "0:2", "0:3"]

    def test_a_store_whose_robot_has_no_pads_is_shown_without_touch(self, own_store: Path) -> None:
        file = own_store / "zarr.json"
        told = json.loads(file.read_text())
        del told["attributes"]["robot"]["pad_size"]
        file.write_text(json.dumps(told))
        with page_of(own_store.parent, own_store) as client:
            assert get(client, "/api/episode/0/1")["pad_size"] is None
            assert get(client, "/api/series/0/1")["tactile"] is None
            assert "no pad_size" in get(client, "/api/tactile/0/1", 503)["error"]

    def test_a_store_that_is_a_link_to_one_is_shown(
        self, stores: tuple[Path, Path], tmp_path: Path
    ) -> None:
        link = tmp_path / "link.zarr"
        link.symlink_to(stores[REAL])
        with page_of(tmp_path, link) as client:
            get_image(client, "/thumb/0/0.jpg", "image/jpeg")


class TestTagging:
    def test_a_tag_is_in_the_store_and_in_the_grid(self, own_store: Path, tmp_path: Path) -> None:
        with page_of(tmp_path, own_store) as client:
            body = {"episodes": [[0, 1], [0, 2]], "who": "ada", "changes": [["tag", "odd"]]}
            answer = post(client, body)["annotations"]
            assert [(a["store"], a["row"], a["annotation"]["tags"]) for a in answer] == [
                (0, 1, ["odd"]),
                (0, 2, ["odd"]),
            ]
            assert get(client, "/api/ids?where=tags%3Dodd") == {"ids": ["0:1", "0:2"]}
            found = get(client, "/api/episode/0/1")
            assert found["annotation"]["by"] == "ada"
            assert [c["value"] for c in found["history"]] == ["odd"]
            body["changes"] = [["untag", "odd"]]
            assert post(client, body)["annotations"][0]["annotation"] is None
            assert get(client, "/api/ids?where=tags%3Dodd") == {"ids": []}
        assert len(AnnotationLog(own_store).history(1)) == 2

    def test_several_stores_are_tagged_at_once(
        self, own_store: Path, stores: tuple[Path, Path], tmp_path: Path
    ) -> None:
        other = Path(shutil.copytree(stores[REAL], tmp_path / "other.zarr"))
        with page_of(tmp_path, own_store, other) as client:
            body = {"episodes": [[1, 0], [0, 3]], "who": "ada", "changes": [["quality", 2]]}
            post(client, body)
            found = get(client, "/api/ids?where=data_quality%3D2")["ids"]
            assert {"0:3", "1:0"} <= set(found)
        assert AnnotationLog(other).of(0).quality == 2  # type: ignore[union-attr]
        assert AnnotationLog(own_store).of(3).quality == 2  # type: ignore[union-attr]

    def test_a_quarantined_episode_can_be_tagged(self, own_store: Path, tmp_path: Path) -> None:
        with page_of(tmp_path, own_store) as client:
            changes = [["note", "why?"], ["tag", "look"]]
            post(client, {"episodes": [[0, QUARANTINED]], "who": "ada", "changes": changes})
            assert get(client, f"/api/episode/0/{QUARANTINED}")["annotation"]["note"] == "why?"

    @pytest.mark.parametrize(
        ("change", "said"),
        [
            ({"episodes": [[0, 99]]}, "99"),
            ({"episodes": [[0, MISSING[0]]]}, str(MISSING[0])),
            ({"episodes": []}, "one pair or more"),
            ({"episodes": [[0]]}, "one pair or more"),
            ({"episodes": [[0, -1]]}, "valid: [store, row]"),
            ({"episodes": [[0, True]]}, "valid: [store, row]"),
            ({"episodes": [[0, 10**30]]}, "valid: [store, row]"),
            ({"episodes": {"0": 1}}, "one pair or more"),
            ({"changes": []}, "one pair or more"),
            ({"changes": [["nope", 1]]}, "nope"),
            ({"changes": [[1, 1]]}, "valid: the name of a change"),
            ({"changes": [["quality", 6]]}, "quality"),
            ({"changes": [["tag", "a,b"]]}, "tag"),
            ({"changes": [["tag", "ok"], ["outcome", "nope"]]}, "outcome"),
            ({"who": 7}, "valid: a name"),
            ({"who": ""}, "who"),
        ],
    )
    def test_a_mistake_changes_nothing(
        self, own_store: Path, tmp_path: Path, change: dict[str, Any], said: str
    ) -> None:
        body = {"episodes": [[0, 1]], "who": "ada", "changes": [["tag", "odd"]]} | change
        with page_of(tmp_path, own_store) as client:
            assert said in post(client, body, 400)["error"]
        assert AnnotationLog(own_store).changes() == []

    def test_a_store_that_is_not_there_is_not_tagged(self, own_store: Path, tmp_path: Path) -> None:
        body = {"episodes": [[0, 1], [5, 1]], "who": "ada", "changes": [["tag", "odd"]]}
        with page_of(tmp_path, own_store) as client:
            assert "no store 5" in post(client, body, 404)["error"]
        assert AnnotationLog(own_store).changes() == []

    def test_what_is_written_stands_although_the_index_cannot_follow(
        self, own_store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def full(*_: object) -> None:
            raise UsageError("index index.sqlite cannot be written: no space")

        monkeypatch.setattr(Index, "annotated", full)
        with page_of(tmp_path, own_store) as client:
            body = {"episodes": [[0, 1]], "who": "ada", "changes": [["tag", "odd"]]}
            assert post(client, body)["annotations"][0]["annotation"]["tags"] == ["odd"]
        assert AnnotationLog(own_store).of(1).tags == ("odd",)  # type: ignore[union-attr]


class TestTheCommand:
    def test_it_prints_the_address_and_ends_quietly_at_ctrl_c(self, own_store: Path) -> None:
        with browsing(own_store) as server:
            assert server.url.startswith("http://127.0.0.1:")
            assert len(server.token) >= 24
            assert server.get("/api/library")[0] == server.get("/thumb/0/0.jpg")[0] == 200
            assert server.stop() == (0, "", "")

    def test_it_ends_quietly_while_many_are_being_answered(self, stores: tuple[Path, Path]) -> None:
        addresses = ["/cloud/0/0/0", "/api/library", "/static/main.js", "/api/series/0/1"]
        for _ in range(scaled(2, 6)):
            with browsing(stores[REAL]) as server, ThreadPoolExecutor(6) as pool:
                is_over = threading.Event()

                def ask(address: str, server: Running = server, over: Any = is_over) -> None:
                    while not over.is_set():
                        with contextlib.suppress(OSError, HTTPException):
                            server.get(address)

                for address in addresses + addresses[:2]:
                    pool.submit(ask, address)
                try:
                    time.sleep(0.3)
                    said = server.stop()
                finally:
                    is_over.set()
            assert said == (0, "", "")

    def test_each_run_has_another_token(self, own_store: Path) -> None:
        with browsing(own_store) as first, browsing(own_store) as second:
            assert first.token != second.token

    def test_many_threads_get_what_one_gets(self, stores: tuple[Path, Path]) -> None:
        with browsing(stores[REAL]) as server:
            addresses = [
                address
                for row in range(4)
                for address in (
                    *(f"/image/0/{row}/front/{kind}/0.png" for kind in ("rgb", "depth", "overlay")),
                    *(f"/api/series/0/{row}", f"/cloud/0/{row}/0", f"/thumb/0/{row}.jpg"),
                    *(f"/api/episode/0/{row}", "/api/episodes?sort=-lift_height", "/api/library"),
                )
            ]
            alone = {address: server.get(address) for address in addresses}
            assert {code for code, _ in alone.values()} == {200}
            with ThreadPoolExecutor(16) as pool:
                todo = addresses * scaled(2, 4)
                for address, got in zip(todo, pool.map(server.get, todo), strict=True):
                    assert got == alone[address]

    def test_a_port_that_is_taken_is_told_in_a_line(
        self, complaint: Callable[..., tuple[int, str]], own_store: Path
    ) -> None:
        with socket.create_server(("127.0.0.1", 0)) as taken:
            port = taken.getsockname()[1]
            code, said = complaint("browse", own_store, "--port", port, "--no-open")
        assert code == 2
        assert said.count("\n") == 1
        assert f"--port {port}: something else listens there" in said

    def test_without_a_port_the_next_free_one_is_taken(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with socket.create_server(("127.0.0.1", 0)) as taken:
            monkeypatch.setattr(serving, "PORT", taken.getsockname()[1])
            with serving.listen("127.0.0.1") as found:
                assert found.getsockname()[1] > taken.getsockname()[1]

    @pytest.mark.parametrize("host", ["192.0.2.1", "no.such.name.invalid"])
    def test_an_address_that_is_not_this_machine_s_is_told(
        self, complaint: Callable[..., tuple[int, str]], own_store: Path, host: str
    ) -> None:
        code, said = complaint("browse", own_store, "--host", host, "--no-open")
        assert (code, said.count("\n")) == (2, 1)
        assert "no such address" in said

    def test_without_the_extra_the_install_line_is_told(
        self,
        complaint: Callable[..., tuple[int, str]],
        own_store: Path,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        monkeypatch.setattr("grasp_factory.core.optional.find_spec", lambda name: None)
        code, said = complaint("browse", own_store, "--no-open")
        assert code == 2
        assert "pip install 'grasp-factory[browse]'" in said

    def test_what_is_no_store_is_told(self, complaint: Callable[..., tuple[int, str]]) -> None:
        code, said = complaint("browse", "nowhere", "--no-open")
        assert (code, said.count("\n")) == (2, 1)
        assert "nowhere" in said

    def test_whoever_listens_beyond_this_machine_is_warned(self, own_store: Path) -> None:
        with browsing(own_store, "--host", "0.0.0.0") as server:
            assert "can see the data" in server.errors.read_text()
            assert server.url.startswith("http://127.0.0.1:")
            assert server.get("/api/live")[0] == 200

    def test_a_server_can_be_stopped_while_a_connection_is_open(
        self, stores: tuple[Path, Path], tmp_path: Path
    ) -> None:
        before = threading.active_count()
        with fresh([stores[REAL]], tmp_path / "index.sqlite") as index:
            app = create_app(index, "", {"127.0.0.1"}, thumbnails=Thumbnails(tmp_path))
            with serving.Server(app, serving.listen("127.0.0.1")) as server:
                idle = HTTPConnection("127.0.0.1", server.port, timeout=20)
                idle.request("GET", "/api/live")
                assert idle.getresponse().read() == b'{"live":false}'
            idle.close()
            with pytest.raises(ConnectionRefusedError):
                idle.request("GET", "/")
        assert threading.active_count() == before

    def test_help_does_not_load_the_server(self) -> None:
        import subprocess

        code = (
            "import sys; from grasp_factory.cli.main import cli\n"
            "try: cli.main(['browse', '--help'])\n"
            "finally: print([m for m in ('flask', 'waitress', 'numpy', 'sqlite3', 'cv2') "
            "if m in sys.modules])"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        assert done.stdout.splitlines()[-1] == "[]"
