"""What a dataset, an episode and the features show: short text, and HTML that cannot harm."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.fake_episodes import JOINTS, make_episode, make_rows, small_config
from support.places import TINY

from grasp_factory import Dataset
from grasp_factory.apps.browse.image_files import thumbnail
from grasp_factory.core.html_parts import LONGEST, curves, html_table, html_text, picture
from grasp_factory.core.real_series import REAL_GROUPS
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr.store import prepare_store

MOST_LINES = 25
ALLOWED = {
    *("div", "p", "b", "span", "table", "tr", "th", "td"),
    *("figure", "figcaption", "img", "svg", "polyline"),
}
NASTY = "<script>alert(1)</script>\x1b[2J\"'&"


class Elements(HTMLParser):
    """Notes the elements of a text, and checks that each is closed and harmless."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.names: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in ALLOWED
        self.names.append(tag)
        for name, value in attrs:
            assert name in {"style", "width", "height", "alt", "src", "role", "aria-label",
                            "fill", "stroke", "stroke-width", "points"}  # fmt: skip
            if name == "src":
                assert str(value).startswith("data:image/jpeg;base64,")
        if tag != "img":
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return Dataset(TINY)


def test_an_episode_is_a_few_lines_of_text_and_a_few_pictures(dataset: Dataset) -> None:
    for episode in dataset:
        lines = repr(episode).splitlines()
        assert len(lines) <= MOST_LINES
        assert max(map(len, lines)) <= 100
        assert lines[0] == f"Episode {episode.spec.index} of seed 5: {episode.outcome}"
        names = Elements(episode._repr_html_()).names
        assert names.count("img") == 2
        assert names.count("svg") == 4


def test_a_dataset_is_a_few_lines_of_text_and_its_first_episodes(dataset: Dataset) -> None:
    assert len(repr(dataset).splitlines()) <= MOST_LINES
    assert repr(dataset[:2]).splitlines()[0].endswith("2 episodes of 4 rows")
    html = dataset._repr_html_()
    assert Elements(html).names.count("img") == 2 * len(dataset)
    assert all(f">{word}</td>" in html for word in dataset["outcome"])


def test_the_lines_are_few_however_much_there_is() -> None:
    """Two lines for each fact, and for each group of series that there can be."""
    config = small_config(video_hz=10, clutter={"count": 5})
    episode = make_episode(config, 0, 5)
    groups = len(episode.series) + len(REAL_GROUPS)
    facts = 5
    assert 1 + 2 * (facts + groups) <= MOST_LINES
    assert len(repr(episode).splitlines()) <= MOST_LINES
    Elements(episode._repr_html_())


def test_an_attempt_without_records_shows_its_pictures(tmp_path: Path) -> None:
    episode = make_episode(small_config(), 3, 0)
    assert Elements(episode._repr_html_()).names.count("svg") == 0
    assert "streams" in repr(episode)


@pytest.mark.parametrize("resolution", [(16, 4096), (4096, 16)])
def test_thin_images_are_shown_small(tmp_path: Path, resolution: tuple[int, int]) -> None:
    """A picture with the proportions of the first would be 51,200 pixels high."""
    config = small_config(resolution=resolution)
    prepare_store(tmp_path / "s", config, JOINTS, 8, {})
    ZarrWriter(tmp_path / "s").write_block(0, make_rows(config, 0, 8))
    dataset = Dataset(tmp_path / "s")
    for shown in (dataset, dataset[0]):
        assert len(shown._repr_html_()) < 1_000_000
    assert len(thumbnail(dataset, 0, "front", 0)) < 100_000


def test_rows_without_an_episode_and_damage_are_shown_in_words(tmp_path: Path) -> None:
    config = small_config()
    prepare_store(tmp_path / "s", config, JOINTS, 9, {})
    empty = Dataset(tmp_path / "s")
    assert Elements(empty._repr_html_()).names.count("img") == 0
    ZarrWriter(tmp_path / "s").write_block(0, make_rows(config, 0, 9, (1,)))
    assert Elements(Dataset(tmp_path / "s")._repr_html_()).names.count("img") == 6
    for file in (tmp_path / "s/cameras/front/rgb").glob("0.*"):
        file.write_bytes(b"no image")
    damaged = Dataset(tmp_path / "s")._repr_html_()
    Elements(damaged)
    assert "cannot be read" in damaged


@given(text=st.text() | st.just(NASTY))
def test_text_is_neither_markup_nor_long(text: str) -> None:
    shown = html_text(text)
    assert not set("<>\"'\x1b\n") & set(shown)
    assert len(shown) <= 12 * LONGEST
    assert Elements(html_table([text], [[text]])).names == ["table", "tr", "th", "tr", "td"]


def test_names_of_a_strangers_store_are_escaped(tmp_path: Path, monkeypatch: Any) -> None:
    episode = make_episode(small_config(), 0, 3)
    monkeypatch.setitem(episode.streams, NASTY, episode.streams["timestamp"])
    assert "\x1b" not in repr(episode)
    assert "<script" not in episode._repr_html_()
    Elements(episode._repr_html_())


@pytest.mark.parametrize("size", [(1, 1), (480, 640), (3, 700)])
def test_a_picture_is_that_image_in_small(size: tuple[int, int]) -> None:
    rgb = np.full((*size, 3), (200, 30, 90), np.uint8)
    found = re.search(r'base64,([^"]+)"', picture(rgb, "x", 100))
    assert found
    image = cv2.imdecode(np.frombuffer(base64.b64decode(found[1]), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.shape[1] == 100
    assert np.abs(image[0, 0, ::-1].astype(int) - (200, 30, 90)).max() < 8


@pytest.mark.parametrize(
    "values",
    [[], [[1.0]], [[np.nan, 1.0], [np.inf, 2.0]], [[1e308], [-1e308]], [[k] for k in range(1000)]],
    ids=len,
)
def test_curves_are_within_their_picture(values: list[list[float]]) -> None:
    points = np.reshape(np.array(values, float), (len(values), -1 if values else 1))
    with np.errstate(over="ignore", invalid="ignore"):
        svg = curves(np.arange(len(values), dtype=float), points, "x")
    Elements(svg)
    known = " ".join(re.findall(r'points="([^"]*)"', svg))
    numbers = [float(x) for x in re.findall(r"[-\d.]+", known)]
    assert len(numbers) <= 2 * 2 * 250
    assert all(0.0 <= x <= 200.0 for x in numbers)
    assert not re.search(r"nan|inf", svg)


def test_features_are_a_table_of_all_arrays(dataset: Dataset) -> None:
    features = dataset.features
    assert set(features) == set(dataset.arrays())
    assert features["episodes/outcome"].names[0] == "success"
    line = next(row for row in repr(features).splitlines() if row.startswith("cameras/front/depth"))
    assert re.split(r"  +", line)[1:4] == ["N x 2 x 72 x 96", "float32", "m"]
    assert Elements(features._repr_html_()).names.count("tr") == len(features) + 1
