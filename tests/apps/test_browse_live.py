"""The live page in a real browser: it follows a run, rings, and says when the run is over."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from selenium.common.exceptions import WebDriverException
from support.browse_process import browsing
from support.browser import DESKTOP, PHONE, Page, chromium
from support.live_run import ALONE, SMALL, LiveRun, running
from support.places import TINY

pytestmark = pytest.mark.slow
SHOTS = os.environ.get("GRASP_FACTORY_SHOTS", "")
"""Folder that screenshots go to, to be looked at."""
ENDLESS = 10_000
"""Episodes of a run that no test sees the end of, however slow the browser is."""


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    with chromium() as page:
        yield page


@pytest.fixture(autouse=True)
def no_complaints(page: Page) -> Iterator[None]:
    page.trouble()
    yield
    # A server that has ended refuses connections, which the browser notes; nothing else may be.
    assert [line for line in page.trouble() if "net::ERR_CONNECTION" not in line] == []


def patiently(run: LiveRun, condition: Callable[[], Any]) -> None:
    """Wait for what depends on the simulation, which takes longer than a page."""

    def holds() -> Any:
        with contextlib.suppress(WebDriverException):  # an element was drawn anew
            return condition()

    run.until(holds)


def shot(page: Page, name: str) -> None:
    if SHOTS:
        page.screenshot(Path(SHOTS) / f"live-{name}.png")


def made(page: Page) -> int:
    return int(page.text("live-made").split(" of ")[0].replace(",", ""))


def loaded(page: Page) -> int:
    """Return how many of the latest episodes show their picture."""
    script = "return [...document.querySelectorAll('img.live-picture')]"
    return int(page.script(f"{script}.filter((i) => i.complete && i.naturalWidth > 0).length"))


def ink(page: Page, chart: str) -> int:
    """Return how many pixels of a chart are painted."""
    return int(
        page.script(
            """
            const chart = document.querySelector(`[data-testid=live-${arguments[0]}-chart]`);
            const canvas = chart.querySelector('canvas');
            const {data} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
            return data.filter((value, i) => i % 4 === 3 && value > 0).length;
            """,
            chart,
        )
    )


@pytest.mark.soak
def test_progress_moves_to_the_end_and_says_how_to_go_on(page: Page, tmp_path: Path) -> None:
    out = tmp_path / "my ds.zarr"
    with running(out, 24) as run:
        page.open(run.url)
        page.until(lambda: page.hash == "#/live", "the printed address leads to the live page")
        page.until(lambda: page.text("live-phase").startswith("Running: "))
        first = made(page)
        patiently(run, lambda: made(page) > first)
        width = page.script("return document.querySelector('.live-bar i').offsetWidth")
        patiently(run, lambda: loaded(page) >= 4)
        assert page.text("no-alarms") == "none"
        assert all(ink(page, chart) > 500 for chart in ("success", "outcomes", "rate"))
        shot(page, "running")
        patiently(run, lambda: page.text("live-phase").startswith("Finished: 24 episodes"))
        assert run.wait() == 0
    assert page.script("return document.querySelector('.live-bar i').offsetWidth") > width
    assert page.one("live-bar").get_attribute("aria-valuenow") == "24"
    assert page.text("live-command") == f"grasp-factory browse '{out}'"
    assert len(page.all("live-card")) == 24
    page.until(lambda: loaded(page) == 24, "all pictures came before the server ended")
    for size, dark, name in (
        (DESKTOP, False, "wide"),
        (DESKTOP, True, "dark"),
        (PHONE, False, "phone"),
    ):
        page.resize(size, dark=dark)
        page.until(lambda: page.overflow() <= 0, f"nothing is wider than the window: {name}")
        shot(page, name)
    page.resize(DESKTOP)


@pytest.fixture(scope="class")
def endless(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveRun]:
    """Return a run of black images that goes on until a test stops it."""
    light = [f"randomize.looks.{name}=[0,0]" for name in ("ambient", "diffuse", "specular")]
    dark = [part for one in light for part in ("--set", one)]
    with running(tmp_path_factory.mktemp("endless") / "ds.zarr", ENDLESS, [*SMALL, *dark]) as run:
        yield run


class TestARunThatGoesOn:
    @pytest.fixture(autouse=True)
    def left(self, page: Page, endless: LiveRun) -> Iterator[None]:
        """Leave the page before its server is killed in the midst of an answer."""
        yield
        page.open("about:blank")

    def test_a_card_leads_to_its_episode_and_back(self, page: Page, endless: LiveRun) -> None:
        page.open(endless.url)
        patiently(endless, lambda: page.all("live-card"))
        card: Any = page.one("live-card")
        store, row = card.get_attribute("data-id").split(":")
        card.find_element("css selector", "a").click()
        page.until(lambda: page.hash.startswith(f"#/episode/{store}/{row}"))
        page.css(".page-episode *")
        page.go("#/live")
        page.until(lambda: page.text("live-phase").startswith("Running: "))

    def test_an_alarm_shows_with_its_episodes(self, page: Page, endless: LiveRun) -> None:
        page.open(endless.url)
        patiently(endless, lambda: page.all("alarm"))
        # The page draws alarms again and again: an element may be gone before it is read.
        alarm = "document.querySelector('[data-testid=alarm][data-kind=image]')"
        assert "is black" in page.script(f"return {alarm}.textContent")
        assert page.script(f"return {alarm}.querySelectorAll('.live-rows a').length") > 0
        assert (
            not page.css("[aria-label=Alarms]")
            .find_element("css selector", "[data-testid=no-alarms]")
            .is_displayed()
        )
        shot(page, "alarm")

    @pytest.mark.soak
    def test_a_run_that_is_stopped_is_said_to_be(self, page: Page, endless: LiveRun) -> None:
        """The last test of the class: the run is over then."""
        page.open(endless.url)
        patiently(endless, lambda: made(page) > 0)
        endless.process.send_signal(signal.SIGINT)
        page.until(lambda: page.text("live-phase").startswith("Stopped: "))
        assert endless.wait() == 130
        assert "run the same command again" in page.css(".live-next").text
        shot(page, "stopped")


def test_quarantined_episodes_show_their_reason_as_text(page: Page, tmp_path: Path) -> None:
    strict = ["--set", "quality.min_sharpness=1", "--set", "quality.min_score=5"]
    options = [*SMALL, *ALONE, *strict, "--max-failures", "1"]
    with running(tmp_path / "ds.zarr", 4, options) as run:
        page.open(run.url)
        patiently(run, lambda: page.text("live-phase").startswith("Finished"))
    cards = page.all("live-card")
    assert {card.get_attribute("data-outcome") for card in cards} == {"quarantined"}
    assert all("sharpness" in card.text for card in cards)
    shot(page, "quarantined")


def test_without_a_run_the_page_says_how_to_watch_one(page: Page, tmp_path: Path) -> None:
    tiny = TINY
    with browsing(tiny, "--index", tmp_path / "index.sqlite") as server:
        page.open(server.url)
        page.css(".page-grid")
        page.go("#/live")
        assert "grasp-factory generate --live" in page.text("live-phase")
