"""A browser for the tests marked `browser`: Debian's Chromium, drawing in software."""

import importlib.util
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium")
SCREENSHOTS = Path(__file__).parents[2] / "build/screenshots"
FLAGS = (
    "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
)  # fmt: skip


def why_no_browser() -> str:
    """What lacks; empty: nothing."""
    for module in ("viser", "playwright"):
        if importlib.util.find_spec(module) is None:
            return f"no module {module}: `make install-dev`"
    return "" if CHROMIUM else "no chromium here: `apt-get install chromium`"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Without a browser these tests are left out, and say so."""
    if reason := why_no_browser():
        for item in items:
            if item.get_closest_marker("browser") is not None:
                item.add_marker(pytest.mark.skip(reason=reason))


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """One browser for all tests."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        try:
            yield launched
        finally:
            launched.close()


@pytest.fixture
def new_page(browser: Any) -> Iterator[Callable[[], Any]]:
    """Makes pages in a context of the test's own."""
    context = browser.new_context(viewport={"width": 900, "height": 480})
    try:
        yield context.new_page
    finally:
        context.close()
