"""The pages of one episode and of two, in a real browser: one slider, labels of people, 3-D."""

from __future__ import annotations

import dataclasses
import json
import shutil
import urllib.request
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from support.browse_process import Running, browsing
from support.browser import DESKTOP, PHONE, Page, chromium
from support.fake_episodes import JOINTS, make_rows, small_config
from support.places import TINY
from support.scale import soak_only

from grasp_factory.cli.main import cli
from grasp_factory.core.enums import Outcome
from grasp_factory.core.episode import Episode
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.base import Quarantined
from grasp_factory.writers.zarr.header import root_attributes
from grasp_factory.writers.zarr.store import create_store

REAL, ODD, FILM = 0, 1, 2
"""The stores, in the order in which they are served."""
RANDOM, EMPTY, QUARANTINED, SCRIPTED = range(4)
"""The rows of ``ODD``."""
ROBOT = {"name": "kuka_iiwa", "pad_size": [0.02, 0.05]}
SCRIPT = "<img src=x onerror=alert(1)>"

pytestmark = pytest.mark.slow


def odd_rows() -> list[Episode | Quarantined]:
    """Return an episode of noise, one without records, a quarantined one and one of scripts."""
    config = small_config()
    rows: list[Episode | Quarantined] = []
    for i in range(4):
        row = make_rows(config, 0, 4)[i]
        assert isinstance(row, Episode)
        if i == EMPTY:
            row = empty(row)
        if i == RANDOM:
            row = in_order(row)
        if i == SCRIPTED:
            columns = {**row.columns, "object_id": SCRIPT, "object_family": SCRIPT}
            row = dataclasses.replace(row, columns=columns)
        rows.append(Quarantined(row.spec, SCRIPT) if i == QUARANTINED else row)
    return rows


def in_order(episode: Episode) -> Episode:
    """Return an episode with times as a clock tells them; all else stays noise with gaps."""
    return dataclasses.replace(
        episode,
        streams={**episode.streams, "timestamp": np.arange(episode.n_steps) / 10},
        own_rate={"imu": {**episode.imu, "timestamp": np.arange(episode.n_imu) / 20}},
    )


def empty(episode: Episode) -> Episode:
    """Return an episode without a plan, so that the arm never moved."""
    planned = ("grasp_position", "grasp_quat_xyzw", "grasp_width", "grasp_score", "lift_height")
    nothing = {name: np.full_like(episode.columns[name], np.nan) for name in planned}
    return dataclasses.replace(
        episode,
        outcome=Outcome.NO_PLAN,
        columns=episode.columns | nothing,
        streams={name: values[:0] for name, values in episode.streams.items()},
        own_rate={
            "imu": {
                name: values if name == "T_tcp_imu" else values[:0]
                for name, values in episode.imu.items()
            }
        },
    )


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    folder = tmp_path_factory.mktemp("episode")
    real, odd, film = (folder / f"{name}.zarr" for name in ("real", "odd", "film"))
    shutil.copytree(TINY, real)
    config = small_config()
    create_store(
        odd, config, root_attributes(config, {"robot": ROBOT}), joints=JOINTS, n=4, carried={}
    )
    ZarrWriter(odd).write_block(0, odd_rows())
    words = "generate --n 1 --seed 4 --policy top_down --resolution 96x72 --video-hz 10 --quiet"
    words += " --camera front --camera wrist"
    made = CliRunner().invoke(cli, [*words.split(), "--out", str(film)])
    assert made.exit_code == 0, made.output
    with browsing(real, odd, film, "--index", folder / "all.sqlite") as server:
        yield server


@pytest.fixture(scope="module")
def tab() -> Iterator[Page]:
    with chromium() as page:
        yield page


@pytest.fixture
def page(tab: Page, server: Running) -> Iterator[Page]:
    """Return the page with the token; nothing may go wrong in the test."""
    tab.resize(DESKTOP)
    if not tab.driver.current_url.startswith(server.plain_url):
        tab.open(server.plain_url)
    tab.script("sessionStorage.clear(); localStorage.clear()")
    tab.trouble()
    tab.open(server.url)
    tab.one("card")
    yield tab
    assert tab.trouble() == []


@pytest.fixture
def show(page: Page) -> Callable[..., Page]:
    """Return a function that opens an episode and waits until all of it is there."""

    def opened(store: int, row: int, search: str = "") -> Page:
        page.go(f"#/episode/{store}/{row}{search}")
        page.until(lambda: page.css("h1").text.endswith(f"#{row}"), f"episode {row}")
        page.one("slider")
        return page

    return opened


@pytest.fixture
def told(server: Running) -> Callable[[str], Any]:
    """Return a function that asks the server what the page asks it."""

    def ask(path: str) -> Any:
        with urllib.request.urlopen(server.plain_url + path) as answer:
            return json.load(answer)

    return ask


def click(page: Page, where: str, words: str) -> None:
    """Press the button with these words that is in an element."""
    buttons = page.css(where).find_elements("css selector", "button")
    button = next(one for one in buttons if one.text == words)
    page.script("arguments[0].scrollIntoView({block: 'center'})", button)
    button.click()


def seek(page: Page, index: int) -> None:
    code = "const [s, i] = arguments; s.value = i; s.dispatchEvent(new Event('input'))"
    page.script(code, page.one("slider"), index)


def picture(page: Page, selector: str) -> str:
    """Return what a canvas shows, as a PNG in a data URL."""
    code = "return document.querySelector(arguments[0]).toDataURL()"
    return str(page.script(code, selector))


def place(page: Page) -> int:
    return int(page.one("slider").get_attribute("value"))


def cursor_times(page: Page) -> set[float]:
    return {float(one.get_attribute("data-time")) for one in page.all("curve-cursor")}


def on_canvas(page: Page) -> str:
    return picture(page, '[data-testid="scene-image"] canvas:not([data-testid])')


def pads(page: Page) -> list[str]:
    return [picture(page, f'[data-testid="tactile-{side}"]') for side in ("left", "right")]


def loaded(page: Page, testid: str) -> bool:
    """Say whether an image is there with its pixels."""
    code = "const i = arguments[0]; return i.complete && i.naturalWidth > 0"
    return bool(page.script(code, page.one(testid)))


def type_into(page: Page, testid: str, text: str) -> None:
    page.one(testid).send_keys(text)


def saved(page: Page) -> None:
    page.until(lambda: page.text("save-state").startswith("Saved"), "saved")


def test_a_card_of_the_grid_opens_the_episode_with_its_images(page: Page) -> None:
    card = page.one("card")
    store, row = card.get_attribute("data-id").split(":")
    card.find_element("css selector", "a").click()
    page.one("scene-image")
    assert page.hash.startswith(f"#/episode/{store}/{row}")
    for name in ("image-before", "image-after"):
        page.until(lambda name=name: loaded(page, name), name)


def test_the_slider_moves_curves_phase_image_and_touch(
    show: Callable[..., Page], told: Callable[[str], Any]
) -> None:
    page, series = show(REAL, 0), told(f"api/series/{REAL}/0")
    page.one("tactile")
    assert len(page.all("curve-cursor")) == len(series["groups"])
    before = on_canvas(page), pads(page)
    index = next(i for i, t in enumerate(series["time"]) if t > series["phases"][3]["start"] + 0.1)
    seek(page, index)
    assert list(cursor_times(page)) == pytest.approx([series["time"][index]], abs=1e-3)
    assert page.text("phase") == series["phases"][3]["name"] == "lift"
    after = on_canvas(page), pads(page)
    assert after[0] != before[0]
    assert after[1] != before[1]
    seek(page, len(series["time"]) - 1)
    scene = page.one("scene-image")
    page.until(lambda: scene.get_attribute("data-source") == "after", "the image after")


def test_keys_on_the_slider_and_brackets_go_record_by_record(show: Callable[..., Page]) -> None:
    page = show(REAL, 0)
    page.one("slider").send_keys("\ue014\ue014\ue014")  # arrow right
    assert place(page) == 3
    page.script("document.activeElement.blur()")
    page.press("]")
    assert place(page) == 4
    page.press("[[")
    assert place(page) == 2
    assert page.hash == f"#/episode/{REAL}/0"


def test_space_plays_on_and_pauses(show: Callable[..., Page]) -> None:
    page = show(REAL, 0)
    page.click("speed")  # a quarter, so that it is not at its end when it is paused
    page.script("document.activeElement.blur()")  # else the space bar presses that button
    page.press(" ")
    page.until(lambda: place(page) > 5, "it plays")
    page.press(" ")
    label = lambda: page.one("play").get_attribute("aria-label")  # noqa: E731
    page.until(lambda: label().startswith("Play"), "it is paused")
    wait = "return new Promise(done => requestAnimationFrame(() => setTimeout(done, 300)))"
    page.script(wait)  # what is drawn may come after the label
    still = place(page)
    page.script(wait)
    assert place(page) == still < int(page.one("slider").get_attribute("max"))


def test_a_quarter_of_the_speed_is_a_quarter_of_the_way(show: Callable[..., Page]) -> None:
    page = show(REAL, 0)
    page.click("speed")
    assert page.text("speed").startswith("0.25")
    code = """
      const done = arguments[0], s = document.querySelector('[data-testid=slider]');
      document.querySelector('[data-testid=play]').click();
      const start = performance.now();
      const look = setInterval(() => {
        if (Number(s.value) < 20) return;
        clearInterval(look);
        done([Number(s.value), (performance.now() - start) / 1000]);
      }, 20);
    """
    records, seconds = page.driver.execute_async_script(code)
    page.press(" ")
    assert 20 <= records <= seconds * 0.25 * 120 + 2


def test_a_click_on_a_curve_moves_the_slider_and_hovering_does_not(
    show: Callable[..., Page],
) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    page = show(REAL, 0)
    over = page.css(".chart .u-over")
    ActionChains(page.driver).move_to_element(over).perform()
    assert place(page) == 0
    ActionChains(page.driver).move_to_element(over).click().perform()
    last = int(page.one("slider").get_attribute("max"))
    assert abs(place(page) - last / 2) <= 0.02 * last


def test_a_drag_zooms_all_curves_alike_and_the_button_shows_all_again(
    show: Callable[..., Page],
) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    page = show(REAL, 0)
    over = page.css(".chart .u-over")
    last = int(page.one("slider").get_attribute("max"))
    seek(page, last)
    shown = 'return [...document.querySelectorAll(".curve-cursor")].filter((c) => !c.hidden).length'
    charts = len(page.all("curve-cursor"))
    assert page.script(shown) == charts
    drag = ActionChains(page.driver).move_to_element_with_offset(over, -100, 0).click_and_hold()
    drag.move_by_offset(40, 0).move_by_offset(40, 0).release().perform()
    page.until(lambda: page.script(shown) == 0, "the end is outside of what is shown")
    assert place(page) == last
    page.click_css(".curves .panel-head button")
    page.until(lambda: page.script(shown) == charts, "all is shown again")


def test_a_group_of_curves_that_is_hidden_stays_hidden_in_the_next_episode(
    show: Callable[..., Page],
) -> None:
    page = show(REAL, 0)
    page.click_css(".chart-chips button")
    page = show(REAL, 1)
    page.one("curve-cursor")
    charts = page.driver.find_elements("css selector", ".chart")
    assert [chart.is_displayed() for chart in charts] == [False] + [True] * (len(charts) - 1)


def test_the_point_cloud_shows_turns_and_follows_the_slider(show: Callable[..., Page]) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    page = show(REAL, 0)
    page.until(lambda: "point" in page.text("cloud-status"), "points")
    cloud = '[data-testid="cloud"]'
    colors = """
      const c = document.querySelector(arguments[0]), gl = c.getContext('webgl2');
      const w = gl.drawingBufferWidth, h = gl.drawingBufferHeight, p = new Uint8Array(4 * w * h);
      gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, p);
      return new Set(new Uint32Array(p.buffer)).size;
    """
    page.until(lambda: page.script(colors, cloud) > 100, "a picture of many colours")
    first = picture(page, cloud)
    canvas = page.one("cloud")
    page.script("arguments[0].scrollIntoView({block: 'center'})", canvas)
    turn = ActionChains(page.driver).move_to_element(canvas).click_and_hold()
    turn.move_by_offset(60, 10).release().perform()
    page.until(lambda: picture(page, cloud) != first, "it turns")
    turned = picture(page, cloud)
    seek(page, 300)
    page.until(lambda: picture(page, cloud) != turned, "the gripper moves")


def test_the_point_cloud_is_seen_from_where_the_whole_arm_is_in_the_picture(
    show: Callable[..., Page],
) -> None:
    page = show(REAL, 0)
    page.until(lambda: "point" in page.text("cloud-status"), "points")
    highest = """
      const c = document.querySelector('[data-testid=cloud]'), gl = c.getContext('webgl2');
      const w = gl.drawingBufferWidth, h = gl.drawingBufferHeight, p = new Uint8Array(4 * w * h);
      gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, p);
      const isArm = (i) => p[4 * i + 2] > p[4 * i] + 60 && p[4 * i + 1] < 170;
      return Array.from({length: w * h}, (_, i) => i).findLast(isArm) / w / h;
    """
    page.until(lambda: page.script(highest), "the arm")
    assert 0.7 < page.script(highest) < 0.99


def test_without_webgl_a_line_says_so_and_all_else_works(page: Page, server: Running) -> None:
    # As in a browser without it: canvases give no context.
    code = """
      const get = HTMLCanvasElement.prototype.getContext;
      HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
        return kind.startsWith('webgl') ? null : get.call(this, kind, ...rest);
      };
    """
    command = "Page.addScriptToEvaluateOnNewDocument"
    added = page.driver.execute_cdp_cmd(command, {"source": code})
    try:
        page.open(f"{server.plain_url}#/episode/{REAL}/0")
        assert "WebGL" in page.text("cloud-status")
        seek(page, 10)
        assert len(cursor_times(page)) == 1
    finally:
        page.driver.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", added)


def test_tags_quality_label_and_note_are_there_after_a_reload(
    show: Callable[..., Page], told: Callable[[str], Any]
) -> None:
    page = show(REAL, 1)
    page.press("t")
    page.press("odd one\n")
    saved(page)
    page.until(lambda: len(page.all("tag")) == 1, "the tag")
    page.script("document.activeElement.blur()")
    page.press("2")
    page.until(lambda: page.css('.score [aria-pressed="true"]').text == "2", "the quality")
    page.press("s")
    page.until(lambda: "success" in page.text("outcome"), "the corrected label")
    type_into(page, "note", f"{SCRIPT} held & lost")
    page.one("note").send_keys("\ue009\n")  # Ctrl-Enter
    page.until(lambda: told(f"api/episode/{REAL}/1")["annotation"]["note"], "the note")
    page.reload()
    assert page.one("tag").get_attribute("data-tag") == "odd one"
    assert page.css('.score [aria-pressed="true"]').text == "2"
    assert page.one("note").get_attribute("value") == f"{SCRIPT} held & lost"
    assert page.one("corrected").get_attribute("value") == "success"
    annotation = told(f"api/episode/{REAL}/1")["annotation"]
    assert (annotation["quality"], annotation["outcome"]) == (2, "success")
    assert annotation["by"] == "tester"
    page.click_css(".changes summary")
    assert "tagged odd one" in page.text("history")
    page.click_css('[data-testid="tag"] button')
    page.until(lambda: not page.all("tag"), "the tag is gone")
    page.reload()
    page.one("tag-input")
    assert page.all("tag") == []


def test_a_box_and_a_point_that_are_drawn_are_stored_in_pixels_of_the_image(
    show: Callable[..., Page], told: Callable[[str], Any]
) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    page = show(REAL, 3)
    page.click("mark-box")
    type_into(page, "mark-label", SCRIPT)
    layer = page.one("marks-0")
    page.script("arguments[0].scrollIntoView({block: 'center'})", layer)
    size = layer.size
    drag = ActionChains(page.driver)
    drag.move_to_element_with_offset(layer, -size["width"] // 4, -size["height"] // 4)
    drag.click_and_hold().move_by_offset(size["width"] // 2, size["height"] // 2).release()
    drag.perform()
    page.until(lambda: len(page.all("mark")) == 1, "the box")
    page.click("mark-point")
    other = page.one("marks-1")
    page.script("arguments[0].scrollIntoView({block: 'center'})", other)
    ActionChains(page.driver).move_to_element(other).click().perform()
    page.until(lambda: len(page.all("mark")) == 2, "the point")
    saved(page)
    box, point = told(f"api/episode/{REAL}/3")["annotation"]["marks"]
    assert (box["shape"], box["frame"], box["camera"], box["label"]) == ("box", 0, "front", SCRIPT)
    assert box["pixels"] == pytest.approx([24, 18, 48, 36], abs=0.5)  # of 96 x 72
    assert (point["shape"], point["frame"]) == ("point", 1)
    assert point["pixels"] == pytest.approx([48, 36], abs=0.5)
    page.reload()
    drawn = page.css(f'rect[data-mark="{box["id"]}"]')
    assert float(drawn.get_attribute("width")) == box["pixels"][2]
    assert page.css("svg text").text == SCRIPT
    page.click_css(f'[data-id="{box["id"]}"] button')
    page.until(lambda: len(page.all("mark")) == 1, "the box is gone")
    assert [mark["id"] for mark in told(f"api/episode/{REAL}/3")["annotation"]["marks"]] == [
        point["id"]
    ]


def test_without_the_token_nothing_can_be_changed_and_the_page_says_why(
    page: Page, server: Running
) -> None:
    page.script("localStorage.clear()")
    page.open(f"{server.plain_url}#/episode/{REAL}/0")
    assert "Open the link" in page.text("read-only-reason")
    for name in ("tag-input", "note", "corrected", "mark-box", "mark-point"):
        assert not page.one(name).is_enabled(), name
    page.press("3")
    assert page.driver.find_elements("css selector", '.score [aria-pressed="true"]') == []


def test_a_refused_change_is_told_and_leaves_what_was_set(show: Callable[..., Page]) -> None:
    page = show(REAL, 2)
    page.script("localStorage.setItem('grasp-factory-token', 'wrong')")
    page.reload()
    page.one("tag-input")
    type_into(page, "tag-input", "never\n")
    page.until(lambda: page.text("save-state").startswith("Not saved"), "the refusal")
    assert page.all("tag") == []
    assert not page.one("tag-input").is_enabled()
    page.trouble()
    for key in ("\ue00c", "\ue014"):  # Escape and the right arrow would lose what was typed
        page.press(key)
        page.until(lambda: "not saved" in page.text("notice"), "it says so")
        assert page.hash == f"#/episode/{REAL}/2"
    assert page.one("tag-input").get_attribute("value") == "never"


def test_arrows_walk_through_the_filter_and_escape_leads_back(show: Callable[..., Page]) -> None:
    search = "?where=store%3D0&sort=-row"
    page = show(REAL, 3, search)
    assert page.text("position") == "1 of 4"
    page.press("\ue014")
    page.until(lambda: page.css("h1").text.endswith("#2"), "the next one")
    assert page.hash == f"#/episode/{REAL}/2{search}"
    page.press("\ue012")
    page.until(lambda: page.css("h1").text.endswith("#3"), "the previous one")
    page.press("\ue012")  # there is none before the first
    assert page.hash == f"#/episode/{REAL}/3{search}"
    page.press("\ue00c")
    page.one("card")
    assert page.hash == f"#/{search}"


def test_an_episode_without_records_shows_its_images_and_says_so(show: Callable[..., Page]) -> None:
    page = show(ODD, EMPTY)
    assert "no plan" in page.text("no-records")
    assert page.text("phase") == "no records"
    assert not page.one("slider").is_enabled()
    assert page.all("curve-cursor") == []
    page.press(" ]")
    page.until(lambda: loaded(page, "image-before"), "the image")
    page.until(lambda: "point" in page.text("cloud-status"), "points")


def test_an_episode_of_noise_and_gaps_shows_without_errors(show: Callable[..., Page]) -> None:
    page = show(ODD, RANDOM)
    last = int(page.one("slider").get_attribute("max"))
    assert last > 2
    for index in range(last + 1):
        seek(page, index)
    assert place(page) == last


def test_records_in_disorder_are_not_shown_and_a_line_says_so(show: Callable[..., Page]) -> None:
    page = show(ODD, SCRIPTED)
    assert "not in order" in page.text("no-records")
    assert page.all("curve-cursor") == []
    page.go(f"#/compare/{ODD}:{SCRIPTED},{REAL}:0")
    page.one("compare-facts")
    seek(page, 100)
    assert page.text("phase").partition(" | ")[2] == "pregrasp"


def test_a_quarantined_episode_shows_its_reason_as_text(page: Page) -> None:
    page.go(f"#/episode/{ODD}/{QUARANTINED}")
    assert SCRIPT in page.text("quarantined")
    assert page.text("outcome") == "quarantined"
    assert page.all("slider") == []
    type_into(page, "tag-input", "look at it\n")
    saved(page)
    assert page.one("tag").get_attribute("data-tag") == "look at it"


def test_scripts_in_names_and_tags_are_inert(show: Callable[..., Page]) -> None:
    page = show(ODD, SCRIPTED)
    assert page.css('[data-fact="object"]').text == SCRIPT
    type_into(page, "tag-input", f"{SCRIPT}\n")
    saved(page)
    page.until(lambda: page.one("tag").get_attribute("data-tag") == SCRIPT, "the tag")
    assert page.driver.find_elements("css selector", "img[onerror], img[src='x']") == []


def test_a_store_with_video_shows_the_frame_of_the_time(
    show: Callable[..., Page], told: Callable[[str], Any]
) -> None:
    page, series = show(FILM, 0), told(f"api/series/{FILM}/0")
    assert len(series["video_time"]) > 3
    scene = page.one("scene-image")
    for frame in (1, 3):
        after = next(i for i, t in enumerate(series["time"]) if t >= series["video_time"][frame])
        seek(page, after)
        assert scene.get_attribute("data-source") == f"video:{frame}"
        shown = "const i = document.querySelector('[data-testid=scene-image] img');"
        code = f"{shown} return i.src.includes('/{frame}.jpg') && i.complete && i.naturalWidth"
        page.until(lambda code=code: page.script(code) == 96, "the frame")


def test_before_the_first_frame_of_a_video_and_at_the_end_the_stills_are_shown(
    show: Callable[..., Page], told: Callable[[str], Any]
) -> None:
    page, series = show(FILM, 0), told(f"api/series/{FILM}/0")
    assert series["time"][0] < series["video_time"][0]
    seek(page, 0)
    assert page.one("scene-image").get_attribute("data-source") == "before"
    seek(page, len(series["time"]) - 1)
    assert page.one("scene-image").get_attribute("data-source") == "after"


def test_motion_cannot_be_asked_for_where_it_cannot_be_drawn(show: Callable[..., Page]) -> None:
    page = show(FILM, 0)
    toggle = "return document.querySelector('.scene .legend input').disabled"
    assert page.script(toggle) is False
    click(page, ".scene", "wrist")
    page.until(lambda: page.script(toggle), "it cannot be asked for")
    assert "a camera that moves" in page.css(".scene .legend").text


def test_each_side_of_a_comparison_has_its_own_camera(page: Page) -> None:
    page.go(f"#/compare/{REAL}:0,{FILM}:0")
    page.one("compare-facts")
    both = lambda: ["point" in one.text for one in page.all("cloud-status")] == [True, True]  # noqa: E731
    page.until(both, "points")
    click(page, "[data-side=B] .scene", "wrist")
    click(page, "[data-side=B] .cloud", "wrist")
    page.until(both, "points")
    sources = """
      return [...document.querySelectorAll('.scene .picture')].map((one) => one.src.split('/')[6]);
    """
    before = page.text("time")
    seek(page, 200)
    assert page.text("time") != before
    page.until(lambda: page.script(sources) == ["front", "wrist"], "a camera on each side")
    page.until(both, "points")


def test_a_comparison_stays_aligned_over_a_reload(page: Page) -> None:
    page.go(f"#/compare/{REAL}:0,{REAL}:1")
    page.one("compare-facts")
    page.click_css('option[value="lift"]')
    assert page.hash == f"#/compare/{REAL}:0,{REAL}:1?align=lift"
    page.driver.refresh()
    page.one("compare-facts")
    assert page.one("align").get_attribute("value") == "lift"
    assert f"{REAL}:1,{REAL}:0?align=lift" in page.css(".episode-head .button").get_attribute(
        "href"
    )
    page.click_css(".episode-head .turn")
    page.one("card")
    assert "align" not in page.hash


def test_the_comparison_shows_two_episodes_by_one_slider(
    page: Page, told: Callable[[str], Any]
) -> None:
    page.go(f"#/compare/{REAL}:0,{REAL}:1")
    page.one("compare-facts")
    assert len(page.all("scene-image")) == 2
    both = [told(f"api/series/{REAL}/{row}") for row in (0, 1)]
    lines = "document.querySelectorAll('.frame canvas:not([data-testid])')"
    canvases = f"return [...{lines}].map((c) => c.toDataURL())"
    before = page.script(canvases)
    seek(page, 200)
    after = page.script(canvases)
    assert all(a != b for a, b in zip(before, after, strict=True))
    page.click_css('option[value="close"]')
    closing = [next(p for p in s["phases"] if p["name"] == "close")["start"] for s in both]
    start = min(s["time"][0] - at for s, at in zip(both, closing, strict=True))
    times = [float(one.get_attribute("data-time")) for one in page.all("scene-image")]
    assert start + closing[0] == pytest.approx(times[0], abs=1e-3) or times[0] == 0
    seek(page, next(i for i, t in enumerate(both[0]["time"]) if t >= closing[0] + 0.2))
    assert "|" in page.text("phase")
    differing = page.driver.find_elements("css selector", "tr.differs[data-fact='outcome']")
    assert len(differing) == 1
    same = page.css("tr[data-fact='split']").find_elements("css selector", "td")
    assert page.css("tr[data-fact='split']").get_attribute("class") == (
        "" if same[0].text == same[1].text else "differs"
    )


def test_the_comparison_shows_touch_of_both_on_one_scale_and_both_in_3d(page: Page) -> None:
    page.go(f"#/compare/{REAL}:0,{REAL}:1")
    page.until(
        lambda: ["point" in one.text for one in page.all("cloud-status")] == [True, True], "points"
    )
    scales = "return [...document.querySelectorAll('.touch .legend')].map((one) => one.textContent)"
    first, second = page.script(scales)
    assert first == second
    assert "N per taxel" in first
    pictures = """
      const canvases = [...document.querySelectorAll('[data-testid=tactile] .heat')];
      return canvases.map((one) => one.toDataURL());
    """
    page.until(lambda: len(page.script(pictures)) == 4, "pads")
    seek(page, 0)
    page.until(lambda: len(set(page.script(pictures))) == 1, "nothing is touched")
    seek(page, 300)
    page.until(lambda: len(set(page.script(pictures))) > 1, "somebody touches something")


def test_two_episodes_are_picked_for_a_comparison_on_their_pages(show: Callable[..., Page]) -> None:
    page = show(REAL, 2)
    page.press("c")
    page.one("notice")
    [key] = page.script("return Object.keys(sessionStorage).filter((k) => k.includes('compare'))")
    assert "real.zarr" in key  # ids mean nothing in other stores
    page = show(REAL, 3)
    page.click("compare")
    page.one("compare-facts")
    assert page.hash == f"#/compare/{REAL}:2,{REAL}:3"


def test_the_selection_of_the_grid_takes_an_episode_from_its_page(
    show: Callable[..., Page],
) -> None:
    page = show(REAL, 2)
    page.press("x")
    assert page.one("select").is_selected()
    page.press("\ue00c")
    page.until(lambda: "1" in page.text("select-count"), "it is selected in the grid")


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
@pytest.mark.parametrize("dark", [False, *soak_only(True)], ids=["light", "dark"])
def test_both_pages_fit_into_the_window(
    show: Callable[..., Page], size: tuple[int, int], *, dark: bool
) -> None:
    page = show(REAL, 0)
    page.resize(size, dark=dark)
    page.one("curve-cursor")
    assert page.overflow() <= 0
    slider = page.one("slider").rect
    assert slider["width"] > size[0] / 3
    bottom = "return arguments[0].getBoundingClientRect().bottom"
    assert page.script(bottom, page.one("slider")) <= size[1]
    page.go(f"#/compare/{REAL}:0,{ODD}:{EMPTY}")
    page.one("compare-facts")
    assert page.overflow() <= 0


@pytest.mark.soak
def test_a_page_that_is_left_stops_playing_and_gives_its_webgl_back(
    show: Callable[..., Page],
) -> None:
    page = show(REAL, 0)
    for _ in range(9):  # a browser keeps 16 contexts at most, and says so in the console
        for row in (1, 0):
            page = show(REAL, row)
            page.press(" ")
    lost = [entry["message"] for entry in page.driver.get_log("browser")]
    assert [message for message in lost if "context" in message.lower()] == []


def test_what_is_typed_stays_until_the_server_has_taken_it(
    show: Callable[..., Page], told: Callable[[str], Any]
) -> None:
    page = show(REAL, 2)
    page.script("window.fetchAsIs = fetch; window.fetch = () => Promise.reject(new Error('away'))")
    type_into(page, "tag-input", "kept tag\n")
    page.until(lambda: page.text("save-state").startswith("Not saved"), "the tag is refused")
    page.until(lambda: page.one("tag-input").get_attribute("value") == "kept tag", "it is back")
    type_into(page, "note", "kept note")
    page.one("note").send_keys("\ue009\n")  # Ctrl-Enter
    page.until(lambda: page.text("save-state").startswith("Not saved"), "the note is refused")
    page.script("document.activeElement.blur()")
    assert page.one("note").get_attribute("value") == "kept note"
    page.script("window.fetch = window.fetchAsIs")
    type_into(page, "tag-input", "\n")
    page.until(lambda: page.all("tag"), "the tag")
    page.click("note")  # and the page is closed with the focus in the note
    page.reload()
    page.until(lambda: page.one("note").get_attribute("value") == "kept note", "the note")
    annotation = told(f"api/episode/{REAL}/2")["annotation"]
    assert (annotation["tags"], annotation["note"]) == (["kept tag"], "kept note")


def test_arrow_keys_count_while_an_episode_is_loading(show: Callable[..., Page]) -> None:
    search = "?where=store%3D0&sort=row"
    page = show(REAL, 0, search)
    key = "document.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowRight'}));"
    page.script(key * 3)
    page.until(lambda: page.css("h1").text.endswith("#3"), "three episodes on")
    assert page.hash == f"#/episode/{REAL}/3{search}"
    page.one("slider")
    assert len(page.all("slider")) == 1


def test_what_another_tab_changed_shows_when_the_page_gets_the_focus(
    show: Callable[..., Page], server: Running
) -> None:
    page = show(REAL, 3)
    body = {"episodes": [[REAL, 3]], "who": "other", "changes": [["tag", "from elsewhere"]]}
    headers = {"X-Token": server.token, "Content-Type": "application/json"}
    request = urllib.request.Request(
        f"{server.plain_url}api/annotations", json.dumps(body).encode(), headers
    )
    urllib.request.urlopen(request).close()
    page.script("window.dispatchEvent(new Event('focus'))")
    page.until(
        lambda: "from elsewhere" in [t.get_attribute("data-tag") for t in page.all("tag")], "it"
    )
    page.click_css(".changes summary")
    assert "other tagged from elsewhere" in page.text("history")


def test_ticks_have_the_decimals_of_their_step(page: Page) -> None:
    code = """
      const done = arguments[arguments.length - 1];
      import('/static/legend.js').then(({tickTexts}) => done(arguments[0].map(tickTexts)));
    """
    asked = [[0, 0.25, 0.5], [0, 0.025], [0, 2.5, 5], [-0.1, 0, 0.1 + 0.2], [10, 20], [0.5]]
    expected = [["0.00", "0.25", "0.50"], ["0.000", "0.025"], ["0.0", "2.5", "5.0"]]
    expected += [["\u22120.1", "0.0", "0.3"], ["10", "20"], ["0.5"]]
    assert page.driver.execute_async_script(code, asked) == expected


def test_a_wrong_address_says_what_is_wrong_and_leads_to_all_episodes(page: Page) -> None:
    for fragment, words in (
        ("#/episode/0", "two numbers"),
        ("#/episode/0/x", "no episode 0/x"),
        (f"#/compare/{REAL}:0,{REAL}:0", "is both"),
    ):
        page.go(fragment)
        page.until(lambda words=words: words in page.css(".state").text, words)
        page.click_css('.state a[href="#/"]')
        page.one("card")


def test_the_first_record_has_its_phase(show: Callable[..., Page]) -> None:
    assert show(REAL, 0).text("phase") == "pregrasp"
