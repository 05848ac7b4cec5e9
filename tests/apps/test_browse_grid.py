"""The page of all episodes, in a real browser: find, filter, select, take along, tag."""

from __future__ import annotations

import json
import subprocess
import sys
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlencode

import pytest
from support.browse_process import Running, browsing
from support.browser import DESKTOP, PHONE, Page, chromium
from support.fake_episodes import JOINTS, make_rows, small_config
from support.scale import soak_only

from grasp_factory.dataset.dataset import Dataset
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.base import Quarantined
from grasp_factory.writers.zarr.header import root_attributes
from grasp_factory.writers.zarr.store import create_store

CONFIG = small_config(block_size=33)
N, PAGE = 132, 60
QUARANTINED = (5, 70)
WIDE = "return arguments[0].naturalWidth"
SCRIPT = "<img src=x onerror=alert(1)>"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store of three pages; row 3 has an object whose id is a script."""
    return make_store(tmp_path_factory.mktemp("grid") / "grasps.zarr", N)


def make_store(path: Path, n: int, seed: int = 0) -> Path:
    config = replace(CONFIG, seed=seed)
    create_store(path, config, root_attributes(config, {}), joints=JOINTS, n=n, carried={})
    for block in range(-(-n // config.block_size)):
        rows = make_rows(config, block, n, QUARANTINED)
        for row in rows:
            if not isinstance(row, Quarantined):
                row.columns["quality"] = 1 + row.spec.index % 5
                row.columns["object_id"] = (
                    SCRIPT if row.spec.index == 3 else f"mug_{row.spec.index}"
                )
        ZarrWriter(path).write_block(block, rows)
    return path


@pytest.fixture(scope="module")
def downloads(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("downloads")


@pytest.fixture(scope="module")
def server(store: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with browsing(store, cache=tmp_path_factory.mktemp("cache")) as server:
        yield server


@pytest.fixture(scope="module")
def tab(server: Running, downloads: Path) -> Iterator[Page]:
    with chromium(downloads) as page:
        yield page


@pytest.fixture
def page(tab: Page, server: Running) -> Iterator[Page]:
    """Return the grid as somebody sees it who opens the printed link; nothing may go wrong."""
    tab.resize(DESKTOP)
    if not tab.driver.current_url.startswith(server.plain_url):
        tab.open(server.plain_url)
    tab.script("sessionStorage.clear(); localStorage.clear()")
    tab.trouble()
    tab.open(server.url)
    settled(tab)
    yield tab
    assert tab.trouble() == []


@pytest.fixture
def api(server: Running) -> Callable[..., Any]:
    """Return a function that asks the server what the page asks it."""

    def ask(path: str, **parameters: Any) -> Any:
        query = urlencode(parameters, doseq=True)
        with urllib.request.urlopen(f"{server.plain_url}{path}?{query}") as answer:
            return json.load(answer)

    return ask


def settled(page: Page) -> None:
    """Wait until what the address asks for has come."""
    busy = "[aria-busy], .card.waiting"
    page.until(lambda: page.all("card") or page.all("grid-state"), "the grid shows")
    page.until(lambda: not page.driver.find_elements("css selector", busy), "the grid is calm")


def ids(page: Page) -> list[str]:
    return page.script(
        "return [...document.querySelectorAll('[data-testid=card]')].map((c) => c.dataset.id)"
    )


def shown_total(page: Page) -> int:
    return int(page.text("total").split()[0].replace(",", ""))


def conditions(page: Page) -> list[str]:
    """Return the conditions in the address."""
    return parse_qs(page.hash.partition("?")[2]).get("where", [])


def filter_by(page: Page, condition: str) -> None:
    page.one("filter-input").send_keys(condition, "\n")
    page.until(lambda: condition in conditions(page), f"{condition} is in the address")
    settled(page)


def bar(page: Page, column: str, value: str) -> Any:
    """Return the bar of a word in the side."""
    within = f'[data-testid="histogram"][data-column="{column}"]'
    return page.css(f'{within} [data-testid="histogram-bar"][data-value="{value}"]')


def press_bar(page: Page, column: str, value: str) -> None:
    """Click a bar, which the page may replace until its numbers are there."""

    def pressed() -> bool:
        bar(page, column, value).click()
        return True

    page.until(pressed, f"the bar {column}={value} is clicked")


def matching(api: Callable[..., Any], *where: str, sort: str = "") -> list[str]:
    return list(api("api/ids", where=where, sort=sort)["ids"])


def calm_grid(page: Page, wanted: list[str]) -> None:
    """Wait for the grid to show a list's first page."""
    page.until(lambda: ids(page) == wanted[:PAGE], f"the grid shows {wanted[:5]} ...")


def keys() -> Any:
    from selenium.webdriver.common.keys import Keys

    return Keys


def test_the_first_page_shows_and_says_how_many_there_are(page: Page) -> None:
    assert shown_total(page) == N
    assert ids(page) == [f"0:{row}" for row in range(PAGE)]
    assert f"1\N{EN DASH}{PAGE} of {N}" in page.text("paging")
    assert "success" in page.text("success-rate")
    assert "2 quarantined" in page.text("success-rate")


def test_the_token_leaves_the_address(page: Page, server: Running) -> None:
    assert server.token
    assert server.token not in page.driver.current_url


def test_a_card_shows_before_and_after_and_says_its_quality(page: Page) -> None:
    card = page.css("[data-testid=card]")
    images = card.find_elements("css selector", "img")
    for image in images:
        page.until(lambda image=image: page.script(WIDE, image) > 0, "a thumbnail")
    frames = [image.get_attribute("src").partition("frame=")[2][0] for image in images]
    assert frames == ["0", "1"]
    assert "very poor" in card.text


def test_the_tour_has_three_steps_by_keyboard_and_shows_but_once(page: Page) -> None:
    page.script("sessionStorage.setItem('is-first-visit', 'yes'); localStorage.clear()")
    page.reload()
    for step in ("1 of 3", "2 of 3", "3 of 3"):
        page.until(lambda step=step: step in page.one("tour").text, step)
        assert page.script("return document.activeElement.dataset.testid") == "tour-next"
        assert page.overflow() <= 0
        page.press(keys().ENTER)
    page.until(lambda: page.all("tour") == [], "it has ended")
    page.reload()
    settled(page)
    assert page.all("tour") == []
    page.press("?")
    page.click("show-tour")
    page.one("tour")
    page.press(keys().ESCAPE)
    page.until(lambda: page.all("tour") == [], "it is dismissed")


def test_on_a_phone_all_that_a_selection_can_do_is_within_the_window(page: Page) -> None:
    page.resize(PHONE)
    page.reload()
    settled(page)
    for row in (1, 2):
        page.click_css(f'[data-id="0:{row}"] .choose')
    page.until(lambda: page.text("select-count") == "2 selected")
    names = ("compare", "bulk-tag", "select-none", "download-ids", "copy-command", "select-all")
    for name in names:
        box = page.one(name).rect
        place = page.script("return arguments[0].getBoundingClientRect().y", page.one(name))
        assert 0 <= box["x"]
        assert box["x"] + box["width"] <= PHONE[0], name
        assert 0 <= place
        assert place + box["height"] <= PHONE[1], name
    page.click("compare")
    page.one("compare-facts")
    assert page.overflow() <= 0
    assert page.script("return document.scrollingElement.scrollHeight") < 3000


def test_a_quarantined_row_shows_its_reason(page: Page) -> None:
    card = page.css('[data-testid=card][data-id="0:5"]')
    assert "no luck with 5" in card.text
    assert "quarantined" in card.text


def test_a_typed_condition_narrows_the_grid_and_is_in_the_address(
    page: Page, api: Callable[..., Any]
) -> None:
    wanted = matching(api, "lift_height>0.5")
    assert 0 < len(wanted) < N
    filter_by(page, "lift_height>0.5")
    calm_grid(page, wanted)
    assert shown_total(page) == len(wanted)
    page.reload()
    settled(page)
    assert ids(page) == wanted[:PAGE]
    page.click_css("[data-testid=filter-chip] button")
    page.until(lambda: conditions(page) == [], "the address holds no condition")
    page.until(lambda: shown_total(page) == N, "all episodes")


def test_the_field_completes_columns_operators_and_values(page: Page) -> None:
    field = page.one("filter-input")
    field.send_keys("outc")
    page.until(lambda: page.all("completion"), "columns")
    page.press(keys().ARROW_DOWN, keys().ENTER)
    page.until(lambda: field.get_attribute("value") == "outcome", "the column")
    page.until(lambda: page.all("completion")[0].text.startswith("outcome ="), "operators")
    page.press(keys().ARROW_DOWN, keys().ENTER)
    page.until(lambda: field.get_attribute("value") == "outcome=", "the operator")
    field.send_keys("colli")
    page.until(lambda: [c.text for c in page.all("completion")] == ["collision"], "values")
    page.press(keys().ARROW_DOWN, keys().ENTER)
    page.until(lambda: conditions(page) == ["outcome=collision"], "the condition")


def test_a_condition_that_cannot_be_understood_is_explained_beside_the_field(page: Page) -> None:
    page.one("filter-input").send_keys("lift_hight>1\n")
    page.until(lambda: "lift_hight" in page.text("filter-error"), "the complaint")
    assert conditions(page) == []
    assert shown_total(page) == N
    assert page.one("filter-input").get_attribute("value") == "lift_hight>1"
    page.one("filter-input").send_keys("x")
    page.until(lambda: not page.all("filter-error")[0].is_displayed(), "the complaint is gone")
    refused(page)


def test_an_address_with_a_bad_condition_says_so_and_offers_the_way_out(page: Page) -> None:
    page.go("#/?where=nonsense")
    page.until(lambda: "nonsense" in page.text("filter-error"), "the complaint")
    page.click_css("[data-testid=grid-state] button")
    page.until(lambda: shown_total(page) == N, "all episodes")
    refused(page)


def refused(page: Page) -> None:
    """Take the browser's own line about an answer of 400 from the console; there is no other."""
    lines = page.trouble()
    assert lines
    assert all("400" in line for line in lines)


def test_conditions_that_nothing_fits_leave_an_empty_page_with_a_way_back(page: Page) -> None:
    filter_by(page, "row<0")
    assert "No episode fits" in page.text("grid-state")
    page.click_css("[data-testid=grid-state] button")
    page.until(lambda: shown_total(page) == N, "all episodes")


def test_a_bar_of_outcomes_filters_and_a_second_one_adds_to_it(
    page: Page, api: Callable[..., Any]
) -> None:
    bars = api("api/histogram", column="outcome")["bars"]
    shown = page.until(lambda: bar(page, "outcome", bars[0]["value"]).text, "the bar has a number")
    assert bars[0]["count"] == int(shown.split()[-1])
    press_bar(page, "outcome", "success")
    calm_grid(page, matching(api, "outcome=success"))
    page.until(lambda: page.text("success-rate").startswith("100.0 %"), "the success rate")
    press_bar(page, "outcome", "collision")
    calm_grid(page, matching(api, "outcome=[success,collision]"))
    page.until(
        lambda: bar(page, "outcome", "success").get_attribute("aria-pressed") == "true",
        "the bar is pressed",
    )
    press_bar(page, "outcome", "success")
    calm_grid(page, matching(api, "outcome=collision"))


@pytest.mark.parametrize(
    "column", ["split", "data_quality", "status", *soak_only("policy", "object_family")]
)
def test_a_facet_filters(page: Page, api: Callable[..., Any], column: str) -> None:
    within = f'[data-testid="histogram"][data-column="{column}"]'
    last = f"{within} .bar:last-child"
    value = page.css(last).get_attribute("data-value")
    page.click_css(last)
    calm_grid(page, matching(api, f"{column}={value}"))
    assert conditions(page) == [f"{column}={value}"]


def test_dragging_over_the_distribution_filters_by_its_range(
    page: Page, api: Callable[..., Any]
) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    plot = page.one("histogram-plot")
    width = plot.size["width"]
    drag = ActionChains(page.driver).move_to_element_with_offset(plot, -width // 4, 0)
    drag.click_and_hold().move_by_offset(width // 2, 0).release().perform()
    page.until(lambda: len(conditions(page)) == 2, "a range in the address")
    assert [c.split("lift_height")[1][:1] for c in conditions(page)] == [">", "<"]
    wanted = matching(api, *conditions(page))
    assert 0 < len(wanted) < N
    calm_grid(page, wanted)


def test_another_measurement_can_be_chosen_and_its_range_typed(
    page: Page, api: Callable[..., Any]
) -> None:
    select(page.one("measurement"), "slip_distance")
    page.css('[data-testid="histogram"][data-column="slip_distance"]')
    assert page.text("measurement-unit") == "mm"
    page.one("range-from").send_keys("250\n")
    page.until(lambda: conditions(page) == ["slip_distance>=0.25"], "the range in the address")
    calm_grid(page, matching(api, "slip_distance>=0.25"))
    page.reload()
    settled(page)
    page.css('[data-testid="histogram"][data-column="slip_distance"]')


def select(element: Any, value: str) -> None:
    from selenium.webdriver.support.ui import Select

    Select(element).select_by_value(value)


def test_sorting_reorders_and_turns_round(page: Page, api: Callable[..., Any]) -> None:
    select(page.one("sort"), "lift_height")
    calm_grid(page, matching(api, sort="lift_height"))
    page.click("sort-direction")
    wanted = matching(api, sort="-lift_height")
    calm_grid(page, wanted)
    page.driver.back()
    calm_grid(page, matching(api, sort="lift_height"))
    page.driver.forward()
    calm_grid(page, wanted)


def test_pages_turn_by_key_by_button_and_by_number(page: Page) -> None:
    page.press("n")
    page.until(lambda: ids(page)[:1] == ["0:60"], "the second page")
    page.press(keys().ARROW_RIGHT, "p")
    page.until(lambda: focused(page) == "0:0", "the first page, and its first card has the focus")
    page.press("n")
    page.until(lambda: focused(page) == "0:60", "the second page, and its first card")
    page.click("next-page")
    page.until(lambda: ids(page) == [f"0:{row}" for row in range(120, N)], "the last page")
    assert not page.one("next-page").is_enabled()
    page.press("p")
    page.until(lambda: ids(page)[:1] == ["0:60"], "the second page again")
    field = page.one("page-number")
    field.send_keys(keys().CONTROL, "a")
    field.send_keys("1\n")
    page.until(lambda: ids(page)[:1] == ["0:0"], "the first page")
    page.go("#/?offset=6000")
    page.until(lambda: "not so many pages" in page.text("grid-state"), "an explanation")


def focused(page: Page) -> str:
    return str(page.script("return document.activeElement.dataset.id ?? ''"))


def test_arrows_move_the_focus_and_enter_opens_and_back_returns_to_the_same_place(
    page: Page,
) -> None:
    filter_by(page, "row>=10")
    page.script("document.activeElement.blur()")
    page.press(keys().ARROW_RIGHT)
    assert focused(page) == "0:10"
    page.press(keys().ARROW_RIGHT, keys().ARROW_DOWN)
    columns = page.script(
        "return getComputedStyle(document.querySelector('.cards'))"
        ".gridTemplateColumns.split(' ').length"
    )
    here = f"0:{11 + columns}"
    assert focused(page) == here
    before = page.hash
    page.press(keys().ENTER)
    page.until(lambda: page.hash.startswith(f"#/episode/0/{11 + columns}?"), "the episode")
    assert conditions(page) == ["row>=10"]
    page.driver.back()
    settled(page)
    assert page.hash == before
    page.until(lambda: focused(page) == here, "the same card has the focus")


def test_the_slash_goes_to_the_filter_and_the_question_mark_lists_the_keys(page: Page) -> None:
    page.press("/")
    active = "return document.activeElement.dataset.testid"
    assert page.script(active) == "filter-input"
    page.press("?")
    assert page.one("filter-input").get_attribute("value") == "?"
    page.one("filter-input").clear()
    page.press(keys().ESCAPE, keys().ESCAPE)
    page.press("?")
    assert "select" in page.text("help")
    page.press(keys().ESCAPE)
    page.until(lambda: not page.all("help"), "the list is closed")


def test_a_selection_survives_pages_and_a_reload_and_makes_the_dataset_of_the_saved_list(
    page: Page, api: Callable[..., Any], store: Path, downloads: Path, tmp_path: Path
) -> None:
    page.press(keys().ARROW_RIGHT, "x")
    page.press("n")
    page.until(lambda: ids(page)[:1] == ["0:60"], "the second page")
    boxes = page.driver.find_elements("css selector", "[data-testid=card] input")
    boxes[1].click()
    shift_click(page, boxes[3])
    wanted = [0, 61, 62, 63]
    page.until(lambda: page.text("select-count") == "4 selected", "four are selected")
    page.reload()
    settled(page)
    assert page.text("select-count") == "4 selected"
    page.click("download-ids")
    file = downloads / "ids.txt"
    page.until(file.exists, "the list is saved")
    assert [int(line) for line in file.read_text().split()] == wanted

    out = tmp_path / "out.zarr"
    command = [sys.executable, "-m", "grasp_factory", "split", store, out, "--ids", file]
    subprocess.run(list(map(str, command)), check=True, capture_output=True)
    assert Dataset(out).column("index").tolist() == wanted
    file.unlink()


def shift_click(page: Page, element: Any) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    shift = keys().SHIFT
    ActionChains(page.driver).key_down(shift).click(element).key_up(shift).perform()


def test_all_that_fit_the_filter_are_selected_as_the_server_lists_them(
    page: Page, api: Callable[..., Any], downloads: Path
) -> None:
    wanted = matching(api, "lift_height>-0.5")
    assert len(wanted) > PAGE
    filter_by(page, "lift_height>-0.5")
    page.until(lambda: page.text("select-all") == f"Select all {len(wanted)}")
    page.click("select-all")
    page.until(lambda: page.text("select-count") == f"{len(wanted)} selected", "all selected")
    page.click("download-ids")
    file = downloads / "ids.txt"
    page.until(file.exists, "the list is saved")
    assert [f"0:{line}" for line in file.read_text().split()] == wanted
    file.unlink()
    page.click("select-none")
    page.until(lambda: not page.all("select-count")[0].is_displayed(), "nothing is selected")
    assert not page.driver.find_elements("css selector", "[data-testid=card][data-chosen]")


def test_exactly_two_can_be_compared(page: Page) -> None:
    page.press(keys().ARROW_RIGHT, "x")
    assert not page.one("compare").is_enabled()
    page.press(keys().ARROW_RIGHT, "x")
    page.until(lambda: page.one("compare").is_enabled(), "two can be compared")
    page.click("compare")
    page.until(lambda: page.hash.startswith("#/compare/0:0,0:1"), "the comparison")
    page.driver.back()
    settled(page)


def test_a_tag_of_many_is_there_after_a_reload_and_filters(page: Page) -> None:
    page.press(keys().ARROW_RIGHT, "x", keys().ARROW_RIGHT, "x", "t")
    page.one("bulk-tag-input").send_keys("odd one\n")
    page.until(lambda: "Tagged" in page.text("notice"), "it says so")
    page.reload()
    settled(page)
    tagged = '[data-testid=card][data-id="0:{}"] [data-testid=tag]'
    assert [page.css(tagged.format(row)).text for row in (0, 1)] == ["odd one", "odd one"]
    press_bar(page, "tags", "odd one")
    calm_grid(page, ["0:0", "0:1"])
    assert conditions(page) == ["tags=odd one"]

    page.click("bulk-tag")
    page.one("bulk-tag-input").send_keys("odd one")
    page.click("bulk-remove")
    page.until(lambda: "No episode fits" in page.text("grid-state"), "nothing has the tag")


def test_quality_of_many_is_set(page: Page, api: Callable[..., Any]) -> None:
    page.press(keys().ARROW_RIGHT, "x", "t")
    select(page.one("bulk-quality"), "5")
    page.click("bulk-judge")
    page.until(lambda: "Quality set" in page.text("notice"), "it says so")
    assert "0:0" in matching(api, "data_quality=5")
    page.click("bulk-tag")
    select(page.one("bulk-quality"), "null")
    page.click("bulk-judge")
    page.until(lambda: "0:0" in matching(api, "data_quality=1"), "the store's own is back")


def test_a_tag_that_cannot_be_is_refused_in_words(page: Page) -> None:
    page.press(keys().ARROW_RIGHT, "x", "t")
    page.one("bulk-tag-input").send_keys("a,b\n")
    page.until(lambda: "tag" in page.text("bulk-said") and "of 1" not in page.text("bulk-said"))
    page.press(keys().ESCAPE, keys().ESCAPE)
    refused(page)


def test_script_in_tags_and_object_ids_is_shown_and_does_nothing(page: Page) -> None:
    card = '[data-testid=card][data-id="0:3"]'
    assert SCRIPT in page.css(card).text
    page.click_css(f"{card} input")
    page.press("t")
    page.one("bulk-tag-input").send_keys(SCRIPT, "\n")
    page.until(lambda: page.css(f"{card} [data-testid=tag]").text == SCRIPT, "the tag, as text")
    press_bar(page, "tags", SCRIPT)
    page.until(lambda: ids(page) == ["0:3"], "the episode with the tag")
    assert page.text("filter-chip").startswith(f"tags={SCRIPT}")
    assert not page.driver.find_elements("css selector", "img[onerror], [src=x]")
    page.press("t")
    page.one("bulk-tag-input").send_keys(SCRIPT)
    page.click("bulk-remove")
    page.until(lambda: page.text("grid-state"), "the tag is gone")


def test_without_the_token_nothing_can_be_tagged_and_the_page_says_why(
    page: Page, server: Running
) -> None:
    page.script("localStorage.clear()")
    page.open(server.plain_url)
    settled(page)
    assert page.text("read-only") == "read only"
    page.press(keys().ARROW_RIGHT, "x")
    assert not page.one("bulk-tag").is_enabled()
    assert "Open the link that the command printed" in page.text("read-only-reason")
    page.press("t")
    assert not page.all("bulk-tag-input")


def test_a_token_of_another_run_is_refused_and_the_page_says_so(
    page: Page, server: Running
) -> None:
    page.open(f"{server.plain_url}#token=of-another-run")
    settled(page)
    page.press(keys().ARROW_RIGHT, "x", "t")
    page.one("bulk-tag-input").send_keys("odd\n")
    page.until(lambda: "link that the command printed" in page.text("bulk-said"), "it says so")
    page.press(keys().ESCAPE, keys().ESCAPE)
    page.until(lambda: not page.one("bulk-tag").is_enabled(), "tagging is off")
    assert all("403" in line for line in page.trouble())


@pytest.mark.parametrize("dark", [False, *soak_only(True)], ids=["light", "dark"])
@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_nothing_is_wider_than_the_window(
    page: Page, size: tuple[int, int], dark: bool, tmp_path: Path
) -> None:
    page.resize(size, dark=dark)
    page.go("#/?where=lift_height%3E-9&where=object_id~mug&sort=-lift_height")
    page.reload()
    settled(page)
    assert page.script("return document.scrollingElement.scrollWidth") <= size[0]
    page.press(keys().ARROW_RIGHT, "x")
    page.until(lambda: page.text("select-count") == "1 selected")
    assert page.overflow() <= 0
    for name in ("select-all", "sort", "filter-input", "download-ids", "next-page", "help-button"):
        box = page.css(f'[data-testid="{name}"], .{name}').rect
        assert box["x"] >= 0
        assert box["width"] >= 24
        assert box["height"] >= 24
    if size == PHONE:
        page.script("scrollTo(0, 0)")
        page.click_css(".side summary")
    page.one("measurement")
    page.one("histogram-plot")
    assert page.overflow() <= 0


def test_an_unknown_address_leads_back(page: Page) -> None:
    page.go("#/nowhere")
    page.until(lambda: "no such page" in page.css("#page").text, "it says so")
    page.click_css("#page a")
    settled(page)
    assert shown_total(page) == N


def test_a_list_of_several_stores_names_them_and_a_command_takes_its_own(
    tab: Page, downloads: Path, tmp_path: Path
) -> None:
    stores = [make_store(tmp_path / f"seed{seed}.zarr", 8, seed) for seed in (0, 1)]
    index = tmp_path / "both.sqlite"
    with browsing(*stores, "--index", index) as both:
        tab.open(both.url)
        settled(tab)
        assert shown_total(tab) == 16
        bar(tab, "store", "1").click()
        tab.until(lambda: ids(tab) == [f"1:{row}" for row in range(8)], "the second store")
        assert "seed1.zarr" in tab.css("[data-testid=card]").text
        tab.press(keys().ARROW_RIGHT, keys().ARROW_RIGHT, "x")
        tab.go("#/")
        tab.until(lambda: len(ids(tab)) == 16, "both stores")
        box = tab.css('[data-testid=card][data-id="0:2"] input')
        tab.script("arguments[0].scrollIntoView({block: 'center'})", box)
        box.click()
        tab.until(lambda: tab.text("select-count") == "2 selected")
        tab.one("copy-command").click()
        said = "return document.querySelector('.command, [data-testid=notice]').textContent"
        lines = [
            f"split {path} selection{i}.zarr --ids ids.txt" for i, path in enumerate(stores, 1)
        ]
        tab.until(lambda: all(line in tab.script(said) for line in lines), "a command for each")
        tab.press(keys().ESCAPE)
        tab.one("download-ids").click()
        file = downloads / "ids.txt"
        tab.until(file.exists, "the list is saved")
        assert file.read_text() == f"{stores[0]}:2\n{stores[1]}:1\n"
    out = tmp_path / "out.zarr"
    command = [sys.executable, "-m", "grasp_factory", "split", stores[1], out, "--ids", file]
    subprocess.run(list(map(str, command)), check=True, capture_output=True)
    assert Dataset(out).column("index").tolist() == [1]
    file.unlink()
    assert tab.trouble() == []


def test_a_store_that_has_gone_is_told_when_all_episodes_are_shown_again(
    tab: Page, tmp_path: Path
) -> None:
    stores = [make_store(tmp_path / f"seed{seed}.zarr", 8, seed) for seed in (0, 1)]
    away = tmp_path / "away"
    with browsing(*stores, "--index", tmp_path / "both.sqlite") as both:
        tab.open(both.url)
        settled(tab)
        for is_there in (False, True):
            stores[1].rename(away) if not is_there else away.rename(stores[1])
            tab.go("#/episode/0/0")
            tab.one("slider")
            tab.go("#/")
            words = "return [...document.querySelectorAll('.troubles p')].map((p) => p.textContent)"
            tab.until(lambda: bool(tab.script(words)) != is_there, "it is told, or no longer")  # noqa: B023
        tab.trouble()


def test_a_store_without_episodes_says_how_to_make_some(tab: Page, tmp_path: Path) -> None:
    path, config = tmp_path / "empty.zarr", CONFIG
    create_store(path, config, root_attributes(config, {}), joints=JOINTS, n=4, carried={})
    with browsing(path) as empty:
        tab.open(empty.url)
        settled(tab)
        assert "grasp-factory generate" in tab.text("grid-state")
    assert tab.trouble() == []


def test_a_server_that_has_gone_is_told_with_what_to_do(
    store: Path, tmp_path_factory: pytest.TempPathFactory, tab: Page
) -> None:
    with browsing(store, cache=tmp_path_factory.mktemp("cache")) as gone:
        tab.open(gone.url)
        settled(tab)
    tab.press("n")
    tab.until(lambda: "does not answer" in tab.text("grid-state"), "it says so")
    tab.trouble()


def test_an_address_with_a_bad_order_says_so_and_offers_the_usual_one(page: Page) -> None:
    page.go("#/?sort=-weight")
    page.until(lambda: "“weight”" in page.text("grid-state"), "the column is named")
    assert "lift_height" in page.text("grid-state")
    page.click_css('[data-testid="grid-state"] button')
    page.one("card")
    assert "sort" not in page.hash
    assert [line for line in page.trouble() if "400" not in line] == []


def test_a_selection_is_of_its_stores_and_of_episodes_that_there_are(
    page: Page, server: Running
) -> None:
    page.script("document.querySelector('[data-testid=card] input').click()")
    [key] = page.script("return Object.keys(sessionStorage).filter((k) => k.includes('selection'))")
    assert "grasps.zarr" in key
    # As another store leaves it that was served at the same address.
    page.script(
        "sessionStorage.clear(); sessionStorage.setItem('grasp-factory-selection', '[\"0:1\"]')"
    )
    page.open(server.plain_url)
    settled(page)
    assert not page.one("total").text.startswith("0")
    assert not page.all("select-count")[0].is_displayed()
    # Store 0 has not so many rows, and there is no store 7.
    page.script(
        "sessionStorage.setItem(arguments[0], arguments[1])", key, '["0:2", "0:99999", "7:0"]'
    )
    page.open(server.plain_url)
    settled(page)
    assert page.text("select-count").startswith("1 ")


def test_a_card_shows_few_of_many_tags_and_how_many_more_there_are(page: Page) -> None:
    code = """
      const done = arguments[arguments.length - 1];
      Promise.all([import('/static/card.js'), import('/static/api.js')]).then(([{card}]) => {
        const row = {store: 0, row: 1, status: 'committed', outcome: 'success', tags: arguments[0],
                     lift_height: -0.00001, checksum: ''};
        const shown = {unit: 'mm', factor: 1000, decimals: 1};
        const library = {stores: [{id: 0}], columns: [{name: 'lift_height', shown}]};
        const node = card(row, new URLSearchParams(), library);
        const texts = (name) => [...node.querySelectorAll(`[data-testid=${name}]`)];
        done([texts('tag').length, texts('more-tags').map((one) => [one.textContent, one.title]),
              node.querySelector('[title="lift height"]').textContent]);
      });
    """
    few = page.driver.execute_async_script(code, ["a", "b", "c"])
    assert few == [3, [], "↑ 0.0 mm"]
    many = page.driver.execute_async_script(code, list("abcde"))
    assert many[:2] == [2, [["+3", "a, b, c, d, e"]]]
