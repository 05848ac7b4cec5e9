"""Clips of attempts on the page: made in a process of their own, which ends when nobody waits."""

from __future__ import annotations

import struct
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from flask import abort
from flask.testing import FlaskClient
from support.browse_process import Running, browsing
from support.browser import DESKTOP, PHONE, Page, chromium
from support.places import TINY
from werkzeug.exceptions import ServiceUnavailable

from grasp_factory.apps.browse import clips
from grasp_factory.apps.browse.app import create_app
from grasp_factory.apps.browse.clips import SIZES, WAITING, Clips, WantedClip
from grasp_factory.apps.browse.open_stores import OpenStores
from grasp_factory.apps.browse.thumbnail_cache import Thumbnails
from grasp_factory.apps.playback.clip import clip_times
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.index import fresh
from grasp_factory.errors import PluginError, StoreError

pytestmark = pytest.mark.slow


def unpack(data: bytes) -> tuple[list[float], list[bytes]]:
    """Return times and JPEG files of a clip."""
    (count,) = struct.unpack_from("<I", data)
    head = [struct.unpack_from("<fI", data, 4 + 8 * i) for i in range(count)]
    place, files = 4 + 8 * count, []
    for _, size in head:
        files.append(data[place : place + size])
        place += size
    assert place == len(data)
    return [time for time, _ in head], files


def moving_row(dataset: Dataset) -> int:
    """Return an episode in which the arm moved."""
    return int(np.flatnonzero(dataset.column("n_steps") > 20)[0])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("clips")


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with browsing(TINY, cache=tmp_path_factory.mktemp("cache")) as server:
        yield server


@pytest.fixture(scope="module")
def tab() -> Iterator[Page]:
    with chromium() as page:
        yield page


class TestTheServer:
    @pytest.fixture
    def client(self, folder: Path) -> Iterator[FlaskClient]:
        with fresh([TINY], folder / "index.sqlite") as index:
            kept = Thumbnails(folder / "thumbnails")
            with create_app(index, "", {"localhost"}, thumbnails=kept).test_client() as client:
                yield client

    def test_a_clip_is_the_recorded_motion_and_is_made_once(
        self, client: FlaskClient, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        dataset = Dataset(TINY)
        row = moving_row(dataset)
        address = f"/clip/0/{row}/front/small"
        made = client.get(address)
        assert made.status_code == 200
        times, files = unpack(made.data)
        end = float(dataset.series(row, "timestamp")["timestamp"][-1])
        assert times == pytest.approx(clip_times(end, SIZES["small"][1]), rel=1e-5)
        images = [cv2.imdecode(np.frombuffer(file, np.uint8), 1) for file in files]
        assert {image.shape[1] for image in images} == {SIZES["small"][0]}
        assert np.abs(images[0].astype(int) - images[-1]).mean() > 1.0
        monkeypatch.setattr(clips, "_rendered", lambda *_: pytest.fail("it is made again"))
        assert client.get(address).data == made.data

    def test_an_episode_that_cannot_be_rendered_says_why_and_nothing_is_kept(
        self, client: FlaskClient, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def fail(*_: object) -> None:
            raise StoreError("its clocks are those of no attempt")

        monkeypatch.setattr(clips, "_rendered", fail)
        answer = client.get("/clip/0/1/front/large")
        assert (answer.status_code, answer.headers["Cache-Control"]) == (200, "no-store")
        assert answer.data == bytes(4) + b"its clocks are those of no attempt"

    @pytest.mark.parametrize("address", ["front/huge", "nowhere/small", "..%2fx/small"])
    def test_a_clip_that_there_is_not_is_not_found(self, client: FlaskClient, address: str) -> None:
        assert client.get(f"/clip/0/0/{address}").status_code == 404

    @pytest.mark.parametrize("waiting", [False, True])
    def test_who_has_gone_keeps_no_place(
        self, folder: Path, waiting: bool, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        clips_of, wanted = self.wanted(folder)
        monkeypatch.setattr(clips, "_rendered", lambda wanted, check: check())
        if waiting:
            clips_of._making.acquire()
        for _ in range(WAITING + 2):
            with pytest.raises(ServiceUnavailable, match="nobody waits"):
                clips_of.get(wanted, lambda: True)

    def test_more_than_a_few_are_refused(
        self, folder: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        clips_of, wanted = self.wanted(folder)
        monkeypatch.setattr(clips, "_rendered", lambda *_: abort(503, "made"))
        clips_of._making.acquire()
        gone = threading.Event()
        waiting = [threading.Thread(target=self.ask, args=(clips_of, wanted, gone))
                   for _ in range(WAITING)]  # fmt: skip
        for thread in waiting:
            thread.start()
        while clips_of._places._value:  # type: ignore[attr-defined]
            gone.wait(0.01)
        with pytest.raises(ServiceUnavailable, match="other clips are being made"):
            clips_of.get(wanted, lambda: False)
        gone.set()
        for thread in waiting:
            thread.join()

    def test_code_of_a_stranger_is_not_run(
        self, folder: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        clips_of, wanted = self.wanted(folder)

        def refuse(config: object) -> None:
            raise PluginError("this is code of a file, which was not given")

        monkeypatch.setattr(clips, "check_given", refuse)
        monkeypatch.setattr(clips, "_rendered", lambda *_: pytest.fail("it is run"))
        with pytest.raises(PluginError):
            clips_of.get(wanted, lambda: False)

    @staticmethod
    def wanted(folder: Path) -> tuple[Clips, WantedClip]:
        index = fresh([TINY], folder / "other.sqlite")
        opened = OpenStores(index.stores).open(0)
        wanted = WantedClip(opened=opened, row=0, version="1", camera="front", size="large")
        return Clips(Thumbnails(folder / "other")), wanted

    @staticmethod
    def ask(clips_of: Clips, wanted: WantedClip, gone: threading.Event) -> None:
        with pytest.raises(ServiceUnavailable):
            clips_of.get(wanted, gone.is_set)


def workers(server: Running) -> list[int]:
    """Return the worker processes of a server, without the tracker of its resources."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            words = stat.read_text().rpartition(")")[2].split()
            command = (stat.parent / "cmdline").read_bytes()
        except OSError:  # it has ended
            continue
        is_alive = words[0] != "Z" and b"resource_tracker" not in command
        if int(words[1]) == server.process.pid and is_alive:
            found.append(int(stat.parent.name))
    return found


class TestThePage:
    @pytest.fixture
    def page(self, tab: Page, server: Running) -> Iterator[Page]:
        """Return the grid; nothing may go wrong."""
        tab.resize(DESKTOP)
        tab.open(server.url)
        tab.one("card")
        yield tab
        assert tab.trouble() == []

    def test_a_card_plays_while_it_is_pointed_at_and_nothing_is_left_running(
        self, page: Page, server: Running
    ) -> None:
        hover(page, 0)
        page.until(lambda: workers(server), "a process renders")
        page.until(lambda: state(page) == "playing", "it plays")
        assert drawn(page, '[data-testid="clip"] canvas')
        assert workers(server) == []
        hover(page, None)
        page.until(lambda: page.all("clip") == [], "it has gone")

    @pytest.mark.parametrize(
        ("row", "leave"),
        [
            (1, lambda page: hover(page, None)),
            (2, lambda page: page.go("#/live")),
            (3, lambda page: page.driver.get("about:blank")),
        ],
        ids=["another place", "another page", "another site"],
    )
    def test_who_leaves_before_the_clip_is_there_leaves_no_process(
        self, page: Page, server: Running, row: int, leave: Callable[[Page], None]
    ) -> None:
        hover(page, row)
        page.until(lambda: workers(server), "a process renders")
        leave(page)
        page.until(lambda: workers(server) == [], "no process is left")

    def test_a_tap_on_the_button_plays_and_a_second_one_ends_it(self, page: Page) -> None:
        page.resize(PHONE)
        page.reload()
        page.click_css(".play-card")
        page.until(lambda: state(page) == "playing", "it plays")
        page.click_css(".play-card")
        page.until(lambda: page.all("clip") == [], "it has gone")

    def test_play_on_the_page_of_an_episode_shows_what_moves(
        self, page: Page, server: Running
    ) -> None:
        row = moving_row(Dataset(TINY))
        page.go(f"#/episode/0/{row}")
        page.script("const [s] = arguments; s.value = s.max >> 1;"
                    "s.dispatchEvent(new Event('input'))", page.one("slider"))  # fmt: skip
        scene = page.one("scene-image")
        source = lambda: str(scene.get_attribute("data-source"))  # noqa: E731
        page.until(lambda: source().startswith("clip:"), "the clip shows")
        assert float(source().removeprefix("clip:")) > 0.5
        assert drawn(page, '[data-testid="scene-clip"]')
        assert workers(server) == []


def hover(page: Page, card: int | None) -> None:
    """Point at the picture of a card, or at none."""
    from selenium.webdriver.common.action_chains import ActionChains

    place = page.css("#top") if card is None else page.css(f'[data-id="0:{card}"] .thumb')
    page.script("arguments[0].scrollIntoView({block: 'center'})", place)
    ActionChains(page.driver).move_to_element(place).perform()


def state(page: Page) -> str:
    found = page.all("clip")
    return str(found[0].get_attribute("data-state")) if found else ""


def drawn(page: Page, selector: str) -> bool:
    """Return whether a canvas has many colours."""
    code = """
        const c = document.querySelector(arguments[0]);
        const { data } = c.getContext('2d').getImageData(0, 0, c.width, c.height);
        return new Set(new Uint32Array(data.buffer)).size > 100;
        """
    return bool(page.script(code, selector))
