"""A real Chromium on a real `grasp-factory browse` process, for tests of the page.

    @pytest.fixture(scope="module")
    def page(tmp_path_factory):
        store = ...                              # a store of the module's own, in tmp
        with browsing(store) as server, chromium() as page:
            page.open(server.url)                # with the token; server.plain_url is without
            yield page

`page.one("total")` and `page.all("card")` find elements by data-testid and wait for them;
`page.until(lambda: ...)` waits for anything. `page.trouble()` returns what the browser complained
of since it was last asked: a test ends with `assert page.trouble() == []`.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import pytest

PATIENCE_S = 60.0
DESKTOP, PHONE = (1280, 720), (390, 844)
NEEDS_BROWSER = "GRASP_FACTORY_NEEDS_BROWSER"
_FLAGS = (
    *("--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-dev-shm-usage"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--disable-extensions", "--hide-scrollbars", "--force-color-profile=srgb"),
    # WebGL without a graphics card, and nothing but WebGL: a page that is put together in the same
    # way takes twice as long.
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"),
    *("--disable-gpu-compositing", "--disable-gpu-rasterization"),
    "--disable-accelerated-2d-canvas",
)
_KNOWS_THE_TOUR = """
try {
  const isFirst = sessionStorage.getItem('is-first-visit');
  if (!isFirst) localStorage.setItem('grasp-factory-tour', 'seen');
} catch {}
"""
"""Without it, the tour of a first visit would take the keys that a test presses."""
T = TypeVar("T")


@contextmanager
def chromium(downloads: Path | None = None) -> Iterator[Page]:
    """Start a headless Chromium with a profile of its own; without one the test is skipped.

    Args:
        downloads: Folder that files of the page go to.
    """
    browser, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not (browser and driver):
        if os.environ.get(NEEDS_BROWSER):
            pytest.fail(f"{NEEDS_BROWSER} is set, and there is no chromium with chromedriver")
        pytest.skip("no chromium with chromedriver")
    os.environ.setdefault("SE_OFFLINE", "true")
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        options = webdriver.ChromeOptions()
        options.binary_location = browser
        for flag in (*_FLAGS, f"--user-data-dir={profile}"):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        if downloads:
            options.add_experimental_option("prefs", {"download.default_directory": str(downloads)})
        service = Service(driver, log_output=subprocess.DEVNULL)
        page = Page(webdriver.Chrome(options=options, service=service))
        try:
            page.driver.execute_cdp_cmd(
                "Page.addScriptToEvaluateOnNewDocument", {"source": _KNOWS_THE_TOUR}
            )
            page.resize(DESKTOP)
            yield page
        finally:
            page.driver.quit()


class Page:
    """The browser's one tab, by the page's data-testid names."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def open(self, url: str) -> None:
        """Load an address afresh, also where only its fragment differs from the present one."""
        self.driver.get("about:blank")
        self.driver.get(url)

    def reload(self) -> None:
        """Load the present address again."""
        self.driver.refresh()

    def all(self, testid: str) -> list[Any]:
        """Return the elements with a data-testid that are there now."""
        return list(self.driver.find_elements("css selector", f'[data-testid="{testid}"]'))

    def one(self, testid: str) -> Any:
        """Wait for the first element with a data-testid to show, and return it."""
        return self.css(f'[data-testid="{testid}"]')

    def css(self, selector: str) -> Any:
        """Wait for the first element of a CSS selector to show, and return it."""

        def shown() -> Any:
            for element in self.driver.find_elements("css selector", selector):
                if element.is_displayed():
                    return element
            return None

        return self.until(shown, f"{selector} shows")

    def click(self, testid: str) -> None:
        """Click the first element with a data-testid, once it shows."""
        self.click_css(f'[data-testid="{testid}"]')

    def click_css(self, selector: str) -> None:
        """Click the first element of a CSS selector, once it shows.

        The page may replace the element between the look and the click: then it is looked for
        again.
        """

        def clicked() -> bool:
            self.css(selector).click()
            return True

        self.until(clicked, f"{selector} is clicked")

    def text(self, testid: str) -> str:
        """Wait until an element has a text, and return it."""
        return str(self.until(lambda: self.one(testid).text, f"{testid} has a text"))

    def until(self, condition: Callable[[], T], what: str = "a condition") -> T:
        """Wait until a condition holds, and return what it returned.

        Elements that the page replaced in the meantime are looked for again.
        """
        from selenium.common.exceptions import WebDriverException

        end, last = time.monotonic() + PATIENCE_S, None
        while True:
            try:
                last = condition()
                if last:
                    return last
            except WebDriverException as error:
                last = error
            if time.monotonic() > end:
                complaint = f"waited {PATIENCE_S:g} s in vain: {what}; last: {last!r}"
                pytest.fail(f"{complaint}; the browser says: {self.trouble()}")
            time.sleep(0.05)

    def script(self, code: str, *arguments: Any) -> Any:
        """Run JavaScript in the page and return its value."""
        return self.driver.execute_script(code, *arguments)

    def press(self, *keys: str) -> None:
        """Press keys, as selenium's Keys or text, wherever the focus is."""
        from selenium.webdriver.common.action_chains import ActionChains

        ActionChains(self.driver).send_keys(*keys).perform()

    @property
    def hash(self) -> str:
        """The address's fragment, with its percent signs."""
        return str(self.script("return location.hash"))

    def go(self, fragment: str) -> None:
        """Follow a link within the page."""
        self.script("location.hash = arguments[0]", fragment)

    def resize(self, size: tuple[int, int], *, dark: bool = False) -> None:
        """Show the page at a size in CSS pixels, in the light or the dark scheme."""
        self.driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": False},
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})

    def overflow(self) -> int:
        """Return by how many pixels the page is wider than the window."""
        return int(
            self.script(
                "const s = document.scrollingElement; return s.scrollWidth - window.innerWidth"
            )
        )

    def screenshot(self, file: Path) -> None:
        """Save what shows as a PNG."""
        file.parent.mkdir(parents=True, exist_ok=True)
        self.driver.save_screenshot(str(file))

    def trouble(self) -> list[str]:
        """Return errors and policy violations in the console since the last call."""
        return [
            entry["message"]
            for entry in self.driver.get_log("browser")
            if entry["level"] == "SEVERE" or "Content Security Policy" in entry["message"]
        ]
