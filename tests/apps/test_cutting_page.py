"""The page on which a session is cut: what it shows, what it writes, and in a real browser."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from flask.testing import FlaskClient
from support.browser import DESKTOP, PHONE, Page, chromium
from support.grasp_sessions import SECONDS, force_at, session, width_at

from grasp_factory.apps.browse.guard import Guard
from grasp_factory.apps.cutting_page.cutting_document import CuttingDocument
from grasp_factory.apps.cutting_page.cutting_routes import cutting_app
from grasp_factory.apps.cutting_page.preview_images import MOST_BYTES, Preview, Previews
from grasp_factory.capture.importing.cut_overview import (
    MOST_POINTS,
    CutOverview,
    cut_overview,
    overview_curve,
)
from grasp_factory.capture.importing.cuts import read_cuts
from grasp_factory.capture.importing.import_settings import CutMethod, ImportSettings
from grasp_factory.capture.importing.importing_store import import_session
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import StoreError, UsageError

TOKEN = "the-token"
SHOTS = os.environ.get("GRASP_FACTORY_SHOTS", "")
"""A folder for screenshots, to look at by eye."""
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return session(tmp_path_factory.mktemp("recorded") / "a session")


@pytest.fixture(scope="module")
def overview(recorded: Path) -> CutOverview:
    return cut_overview(recorded, ImportSettings())


def client_of(overview: CutOverview, file: Path, previews: Previews) -> FlaskClient:
    guard = Guard.of({"localhost"}, TOKEN)
    return cutting_app(overview, previews, CuttingDocument.open(file), guard).test_client()


def saved(client: FlaskClient, cuts: Any, token: str = TOKEN) -> tuple[int, Any]:
    answer = client.post("/api/cuts", json={"cuts": cuts}, headers={"X-Token": token})
    return answer.status_code, answer.get_json()


def test_curves_are_those_that_were_recorded_in_the_units_of_pictures(
    overview: CutOverview, tmp_path: Path
) -> None:
    state = client_of(overview, tmp_path / "c.csv", Previews()).get("/api/cutting").get_json()
    curves = {curve["name"]: curve for curve in state["curves"]}
    assert set(curves) == {"gripper_width", "force", "angular_velocity"}
    grip, force = curves["gripper_width"], curves["force"]
    assert (grip["unit"], force["unit"]) == ("mm", "N")
    expected = 1e3 * width_at(np.array(grip["times"]))
    np.testing.assert_allclose(grip["values"], expected, atol=0.2)
    np.testing.assert_allclose(force["values"], force_at(np.array(force["times"])), atol=0.1)
    assert state["duration_s"] == pytest.approx(SECONDS, abs=0.02)
    assert [event["name"] for event in state["events"]] == ["episode_start", "episode_end"]


def test_a_long_curve_loses_no_extreme() -> None:
    values = np.sin(np.arange(3.0 * MOST_POINTS))
    values[7000], values[8000], values[9000] = 5.0, -5.0, np.nan
    curve = overview_curve("force", np.arange(len(values)) / 500.0, values)
    assert len(curve.values) <= MOST_POINTS
    assert (curve.values.max(), curve.values.min()) == (5.0, -5.0)
    assert curve.times_s[curve.values.argmax()] == 14.0
    assert (np.diff(curve.times_s) > 0.0).all()


def test_proposals_are_what_an_import_would_cut(recorded: Path, overview: CutOverview) -> None:
    assert set(overview.proposals) == {CutMethod.EVENTS, CutMethod.GRIPPER}
    (found,) = overview.proposals[CutMethod.EVENTS]
    made = import_session(recorded, recorded.parent / "events.zarr", ImportSettings())
    (row,) = made.rows
    assert overview.since_start(found.start_ns) == pytest.approx(row.start_s, abs=1e-3)
    assert (found.end_ns - found.start_ns) / 1e9 == pytest.approx(row.duration_s, abs=1e-3)


def test_what_is_saved_is_what_is_imported(
    recorded: Path, overview: CutOverview, tmp_path: Path
) -> None:
    file = tmp_path / "cuts.csv"
    code, answer = saved(
        client_of(overview, file, Previews()), [[3.5, 5.5, ""], [1.25, 3, "success"]]
    )
    assert (code, answer["cuts"]) == (200, [[1.25, 3.0, "success"], [3.5, 5.5, ""]])
    assert file.read_text() == "start,end,outcome\n1.250,3.000,success\n3.500,5.500,\n"
    settings = ImportSettings(cut=CutMethod.LIST)
    import_session(recorded, tmp_path / "r.zarr", settings, listed=read_cuts(file))
    dataset = Dataset(tmp_path / "r.zarr")
    assert dataset["duration"].tolist()[0] == pytest.approx(1.75)
    assert dataset["label_operator"].tolist()[0] == "success"


def test_a_file_that_exists_is_where_the_page_begins(overview: CutOverview, tmp_path: Path) -> None:
    file = tmp_path / "cuts.csv"
    file.write_text("start,end\n1,2\n")
    client = client_of(overview, file, Previews())
    assert client.get("/api/cutting").get_json()["cuts"] == [[1.0, 2.0, ""]]
    assert saved(client, [])[0] == 200
    assert read_cuts(file) == ()


def test_proposals_that_touch_can_be_saved(overview: CutOverview, tmp_path: Path) -> None:
    client = client_of(overview, tmp_path / "c.csv", Previews())
    for cuts in client.get("/api/cutting").get_json()["proposals"].values():
        assert saved(client, cuts)[0] == 200


@pytest.mark.parametrize(
    ("cuts", "said"),
    [
        ([[1, 2, ""], [1.5, 3, ""]], "the episode from 1.500 s on begins before"),
        ([[2, 1, ""]], "episode 1: got [2, 1, ''], valid: start and end in seconds"),
        ([[0, 1, ""], [2, 3, "sucess"]], "episode 2: got [2, 3, 'sucess'], valid: "),
        ([[1, float("inf"), ""]], "episode 1: got "),
        ([["1", 2, ""]], "episode 1: got ['1', 2, ''], valid: [start, end, outcome]"),
        ([[1, 2]], "episode 1: got [1, 2], valid: [start, end, outcome]"),
        ("all", "cuts: valid: a list of"),
        (None, "cuts: valid: a list of"),
    ],
)
def test_what_cannot_be_a_list_is_refused_and_nothing_is_written(
    overview: CutOverview, tmp_path: Path, cuts: Any, said: str
) -> None:
    file = tmp_path / "cuts.csv"
    file.write_text("start,end,outcome\n1.0,2.0,\n")
    code, answer = saved(client_of(overview, file, Previews()), cuts)
    assert code in (400, 503)
    assert said in answer["error"]
    assert file.read_text() == "start,end,outcome\n1.0,2.0,\n"


def test_only_the_printed_link_may_write(overview: CutOverview, tmp_path: Path) -> None:
    client = client_of(overview, tmp_path / "cuts.csv", Previews())
    assert saved(client, [], token="another")[0] == 403
    assert not (tmp_path / "cuts.csv").exists()


def test_a_file_that_something_else_changed_is_not_replaced(
    overview: CutOverview, tmp_path: Path
) -> None:
    file = tmp_path / "cuts.csv"
    client = client_of(overview, file, Previews())
    file.write_text("start,end\n0.5,0.75\n")
    code, answer = saved(client, [[1, 2, ""]])
    assert code == 400
    assert "was changed by something else" in answer["error"]
    assert file.read_text() == "start,end\n0.5,0.75\n"


def test_a_file_that_is_no_list_is_refused_before_a_page_is_served(tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_text("time,label\n")
    with pytest.raises(UsageError, match=r"c\.csv: line 1: got .*, valid: start,end,outcome"):
        CuttingDocument.open(tmp_path / "c.csv")
    (tmp_path / "link.csv").symlink_to(tmp_path / "elsewhere.csv")
    with pytest.raises(StoreError, match="is a link"):
        CuttingDocument.open(tmp_path / "link.csv")
    with pytest.raises(UsageError, match="there is no folder"):
        CuttingDocument.open(tmp_path / "none" / "c.csv")


def test_pictures_are_those_of_the_camera_at_their_times(
    recorded: Path, overview: CutOverview, tmp_path: Path
) -> None:
    previews = Previews()
    previews.start(recorded, overview.start_ns, overview.duration_s).join()
    client = client_of(overview, tmp_path / "c.csv", previews)
    found = client.get("/api/previews").get_json()
    assert (found["done"], found["trouble"], set(found["times"])) == (True, "", {"front"})
    times = found["times"]["front"]
    assert np.diff(times).min() > 0.09
    assert len(times) == pytest.approx(10 * SECONDS, abs=31)
    first = client.get("/preview/front/0.jpg").data
    shown = cv2.imdecode(np.frombuffer(first, np.uint8), cv2.IMREAD_COLOR)
    assert shown is not None
    assert shown.shape == (24, 32, 3)
    for missing in ("/preview/front/9999.jpg", "/preview/back/0.jpg", "/preview/front/-1.jpg"):
        assert client.get(missing).status_code == 404


def test_pictures_do_not_grow_without_end() -> None:
    previews = Previews()
    for k in range(3):
        previews.add(Preview("front", float(k), b"x" * (MOST_BYTES // 2)))
    assert previews.times_s["front"] == [0.0, 1.0]
    assert "left out: too many bytes" in previews.trouble


def test_a_damaged_session_is_one_line(recorded: Path, tmp_path: Path, run: Run) -> None:
    folder = tmp_path / "s"
    shutil.copytree(recorded, folder)
    content = (folder / "session.mcap").read_bytes()
    (folder / "session.mcap").write_bytes(content[: len(content) // 2])
    code, out, err = run("capture", "cut", folder, "--no-open", "--out", tmp_path / "c.csv")
    assert (code, out) == (1, "")
    assert err.count("\n") == 1
    assert not (tmp_path / "c.csv").exists()


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    with chromium() as page:
        yield page


def value(page: Page, row: int, name: str) -> str:
    return str(page.all(f"cut-{name}")[row].get_attribute("value"))


@pytest.mark.slow
def test_a_person_cuts_a_session_in_a_browser(page: Page, recorded: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "grasp_factory", "capture", "cut", recorded, "--no-open"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            url = server.stdout.readline().strip()
            assert re.fullmatch(r"http://127\.0\.0\.1:\d+/#token=\S+", url)
            cut_in(page, url)
        finally:
            server.terminate()
    assert (tmp_path / "cuts.csv").read_text() == "start,end,outcome\n1.000,3.500,\n"


def cut_in(page: Page, url: str) -> None:
    page.open(url)
    width = "return document.querySelector('.cut-pictures img').naturalWidth"
    page.until(lambda: page.script(width) == 32, "a picture of the camera")
    page.click("cut-take-events")
    page.until(lambda: len(page.all("cut-row")) == 1)
    assert value(page, 0, "start") == "1.000"
    page.click("cut-remove")
    move(page, 1.0)
    page.click("cut-begin")
    move(page, 3.5)
    page.until(lambda: page.text("cut-time") == "3.50 s")
    look_at_all_sizes(page)
    page.click("cut-end")
    page.until(lambda: len(page.all("cut-row")) == 1)
    assert "1 episode in cuts.csv, not saved" in page.text("cut-said")
    page.click("cut-save")
    page.until(lambda: page.text("cut-said") == "1 episode in cuts.csv")
    assert "capture import" in page.text("cut-next")
    assert "--cuts cuts.csv" in page.text("cut-next")
    assert page.trouble() == []


def move(page: Page, at: float) -> None:
    page.script(
        "const s = document.querySelector('[data-testid=cut-slider]');"
        f"s.value = {at}; s.dispatchEvent(new Event('input'));"
    )


def look_at_all_sizes(page: Page) -> None:
    for size, dark, name in (
        (DESKTOP, False, "wide"),
        (DESKTOP, True, "dark"),
        (PHONE, False, "phone"),
    ):
        page.resize(size, dark=dark)
        page.until(lambda: page.overflow() <= 0, f"nothing is wider than the window: {name}")
        if SHOTS:
            page.screenshot(Path(SHOTS) / f"cutting-{name}.png")
    page.resize(DESKTOP)
