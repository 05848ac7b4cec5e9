"""The live page of a session, in a real browser, against a real recorder."""

from __future__ import annotations

import json
import os
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.browser import DESKTOP, PHONE, Page, chromium
from support.session_run import ARM, CAMERA, IMU, WRENCH, SessionRun, device, recording

from grasp_factory.apps.session_page.session_pictures import picture
from grasp_factory.capture.samples import CameraFrame, TactileReading, WrenchReading

pytestmark = pytest.mark.soak

SHOTS = os.environ.get("GRASP_FACTORY_SHOTS", "")
"""A folder for screenshots, to look at by eye."""
DEVICES = {
    "front": device(CAMERA, width=640, height=480, with_depth=True),
    "wrist_camera": device(CAMERA, width=320, height=240),
    "imu": device(IMU, freeze_at_s=1.0),
    "wrist": WRENCH,
    "arm": ARM,
    "skin": {"driver": "ticking_taxels", "rate_hz": 50, "settings": {"rate_hz": 50}},
}


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    with chromium() as page:
        yield page


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SessionRun]:
    folder = tmp_path_factory.mktemp("live")
    with recording(folder, DEVICES, "--live", operator="A. Person", task="pick") as run:
        yield run


@pytest.fixture(autouse=True)
def no_complaints(request: pytest.FixtureRequest) -> Iterator[None]:
    if "page" not in request.fixturenames:
        yield
        return
    page = request.getfixturevalue("page")
    page.trouble()
    yield
    # A server that has ended refuses connections, which the browser notes; nothing else may be.
    assert [line for line in page.trouble() if "net::ERR_CONNECTION" not in line] == []


def shot(page: Page, name: str, *, dark: bool = False) -> None:
    """Save a picture of the whole page."""
    if SHOTS:
        height = page.script("return document.scrollingElement.scrollHeight")
        width = page.script("return window.innerWidth")
        page.resize((width, max(720, height)), dark=dark)
        page.screenshot(Path(SHOTS) / f"session-{name}.png")


def painted(page: Page) -> int:
    """Return how many charts have lines."""
    return int(
        page.script(
            """
            return [...document.querySelectorAll('[data-testid=session-chart] canvas')].filter(
              (c) => c.getContext('2d').getImageData(0, 0, c.width, c.height).data
                .filter((value, i) => i % 4 === 3 && value > 0).length > 1500).length;
            """
        )
    )


def loaded(page: Page) -> int:
    script = "return [...document.querySelectorAll('[data-testid=session-image]')]"
    return int(page.script(f"{script}.filter((i) => i.complete && i.naturalWidth > 0).length"))


def test_images_curves_rates_and_alarms_show(page: Page, session: SessionRun) -> None:
    page.open(session.url)
    page.until(lambda: page.text("session-phase").startswith("Recording: "))
    page.until(lambda: loaded(page) == 4, "two images, depth and taxels")
    page.until(lambda: painted(page) == 6, "IMU, wrench and joints twice")
    alarm = page.css("[data-testid=alarm][data-device=imu][data-kind=frozen]")
    assert "the same values" in alarm.text
    rows: dict[str, Any] = {row.get_attribute("data-device"): row for row in page.all("stream")}
    assert set(rows) == set(DEVICES)
    page.until(lambda: "500 Hz" in page.css("[data-device=wrist][data-testid=stream]").text)
    assert "A. Person" in page.css(".live-figures").text
    for size, dark, name in (
        (DESKTOP, False, "wide"),
        (DESKTOP, True, "dark"),
        (PHONE, False, "phone"),
    ):
        page.resize(size, dark=dark)
        page.until(lambda: page.overflow() <= 0, f"nothing is wider than the window: {name}")
        page.until(lambda: painted(page) == 6, "the charts have their size")
        shot(page, name, dark=dark)
    page.resize(DESKTOP)


def test_the_image_on_the_page_is_the_latest_one(page: Page, session: SessionRun) -> None:
    page.open(session.url)
    page.until(lambda: loaded(page) >= 1)
    sources = set[str]()

    def changes() -> bool:
        sources.add(str(page.css("[data-testid=session-image]").get_attribute("src")))
        return len(sources) >= 3

    page.until(changes, "the image is fetched again and again")


def test_a_mark_becomes_an_event(page: Page, session: SessionRun) -> None:
    page.open(session.url)
    page.until(lambda: page.text("session-phase").startswith("Recording: "))
    page.click("episode-start")
    page.until(lambda: page.css("[data-event=episode_start]").is_displayed())
    page.click("episode-success")
    page.until(lambda: "success: yes" in page.css("[data-event=episode_end]").text)


def asked(session: SessionRun, path: str, body: object, token: str) -> int:
    base = session.url.partition("/#")[0]
    request = urllib.request.Request(
        f"{base}{path}",
        json.dumps(body).encode(),
        {"Content-Type": "application/json", "X-Token": token},
    )
    try:
        with urllib.request.urlopen(request, timeout=20) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return error.code


def test_only_the_printed_link_may_mark_and_stop(session: SessionRun) -> None:
    token = session.url.partition("#token=")[2]
    assert asked(session, "/api/stop", {}, "x") == 403
    assert asked(session, "/api/mark", {"event": "episode_start"}, "") == 403
    assert asked(session, "/api/mark", {"event": "session_ended"}, token) == 400
    assert asked(session, "/api/mark", [1, 2], token) == 400
    assert asked(session, "/api/mark", {"event": "note", "text": "the cup is wet"}, token) == 200
    assert session.process.poll() is None


def test_the_stop_button_ends_the_session_cleanly(page: Page, session: SessionRun) -> None:
    """The last test with this session."""
    page.open(session.url)
    page.until(lambda: page.text("session-phase").startswith("Recording: "))
    page.click("stop")
    page.until(lambda: page.text("session-phase").startswith("Ended after "))
    assert "stopped on this page" in page.text("session-phase")
    assert page.text("session-command") == f"grasp-factory capture info {session.out}"
    shot(page, "ended")
    assert session.wait() == 0
    record = session.record()
    assert (record["ended"], record["ended_cleanly"]) == ("page", True)


def test_a_page_says_that_the_recorder_is_gone(page: Page, tmp_path: Path) -> None:
    with recording(tmp_path, {"imu": IMU}, "--live") as run:
        page.open(run.url)
        page.until(lambda: page.text("session-phase").startswith("Recording: "))
        run.process.kill()
        page.until(lambda: page.text("session-phase").startswith("The recorder is gone"))
        assert page.text("session-command") == f"grasp-factory capture recover {run.out}"
        page.open("about:blank")


def test_a_port_that_is_taken_is_said_before_anything_is_recorded(tmp_path: Path) -> None:
    import socket

    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with recording(tmp_path, {"imu": IMU}, "--live", "--live-port", port) as run:
            assert run.wait() == 2
        assert f"--live-port {port}" in run.stderr
        assert not run.out.exists()


def test_a_picture_is_made_of_what_the_sample_has() -> None:
    rgb = np.zeros((48, 64, 3), np.uint8)
    depth = np.zeros((48, 64), np.uint16)
    camera = CameraFrame(rgb=rgb, depth=depth)
    assert picture(camera, "rgb")[:2] == b"\xff\xd8"  # type: ignore[index]
    assert picture(camera, "depth") is not None
    assert picture(CameraFrame(rgb=rgb), "depth") is None
    assert picture(TactileReading(pressure=np.full((3, 2), np.nan)), "taxels") is not None
    assert picture(WrenchReading(wrench=np.zeros(6)), "rgb") is None
