"""Pages as a person sees them: in Chromium, wide and on a phone, where it is installed."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
ARGUMENTS = ("--no-sandbox",)
"""A container's root has none, and what is shown is ours."""
WIDTHS = (1280, 390)
"""Widths of a desk's screen and of a phone [px]."""
HEIGHT = 844
LOCAL = ("file:", "data:", "blob:")
TOO_WIDE = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
ALL_PICTURES = """() => Promise.all([...document.images].map(x => {
    x.loading = "eager";  // those far below would wait until they come near
    return x.decode().catch(() => null);
}))"""
EMPTY = "[...document.images].filter(x => !x.naturalWidth).map(x => x.alt || x.src)"


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """Chromium, headless; tests that want it are left out where there is none."""
    api = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("no chromium")
    with api.sync_playwright() as player:
        browser = player.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield browser
        browser.close()


def wrong(browser: Any, page: Path, width: int) -> list[str]:
    """Return the defects of a page on a screen of this width [px].

    Defects are network requests, script errors, pictures that do not show, and a page that is
    wider than the screen.
    """
    found: list[str] = []

    def ask(route: Any) -> None:
        url = route.request.url
        if url.startswith(LOCAL):
            route.continue_()
        else:
            found.append(f"asks for {url}")
            route.abort()

    context = browser.new_context(viewport={"width": width, "height": HEIGHT})
    context.route("**/*", ask)
    view = context.new_page()
    view.on("pageerror", lambda error: found.append(f"error: {error}"))
    view.on("requestfailed", lambda request: found.append(f"does not get {request.url}"))
    view.goto(page.as_uri())
    view.evaluate(ALL_PICTURES)
    beyond = view.evaluate(TOO_WIDE)
    if beyond > 0:
        found.append(f"is {beyond} px too wide")
    found += [f"shows no picture: {name}" for name in view.evaluate(EMPTY)]
    context.close()
    return found
