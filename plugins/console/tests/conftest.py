"""One browser, one service and one world for all tests of the console."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from firstfix_client import Client
from firstfix_console.page import page_files
from plugins.console.tests import browser as browsers
from plugins.console.tests.accessible import AXE, violations

if TYPE_CHECKING:
    from plugins.console.tests.console_world import ConsoleWorld
    from plugins.console.tests.page import Page

WINDOW_PX = (960, 600)  # not larger: software GL takes time for each pixel of a map
CHECKED_PX = (1280, 800)  # at the end: axe-core skips the text that one would have to scroll to


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[browsers.Browser]:
    if not page_files():
        pytest.skip("needs the console: make console")
    if not AXE.exists():
        pytest.skip("needs axe-core: make console")
    with browsers.running_browser(tmp_path_factory.mktemp("browser")) as running:
        yield running


@pytest.fixture(scope="session")
def world(
    browser, coarse_version, small_version, small_scans, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[ConsoleWorld]:
    from plugins.console.tests.console_world import running_console

    folder = tmp_path_factory.mktemp("console")
    with running_console(folder, browsers.HOST, (coarse_version, small_version), small_scans) as running:
        yield running


@pytest.fixture(scope="session")
def house_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A house of two storeys as a mesh file."""
    from plugins.console.tests.console_world import house

    return house().write(tmp_path_factory.mktemp("house") / "house.ply")


@pytest.fixture
def house(world: ConsoleWorld, house_file: Path) -> str:
    """The map "house" in the service, built there if no test has built it before."""
    if not any(one["map_id"] == "house" for one in world.get("/maps")["maps"]):
        with Client(world.service.url, api_key=world.keys["admin"]) as client:
            # its storeys look alike, so that its self-test localizes few scans; and nobody asks it
            config = {
                "sensor": "vlp-16",
                "activate": {"min_found": 0},
                "learn_keys": {"scans": 0},
                "self_test": {"queries": 12, "outside": 2},
            }
            client.wait_for_build(client.build_map(house_file, "house", config=config).build_id)
    return "house"


@pytest.fixture
def visitor(browser, world) -> Iterator[Page]:
    """A page of somebody who is not signed in. Nothing may go wrong in it unseen."""
    with browser.page(world.origin) as page:
        page.size(*WINDOW_PX)
        yield page
        if page.window_px == WINDOW_PX:  # no phone
            page.size(*CHECKED_PX)
        page.prefers("light")
        assert not violations(page), "light"
        page.prefers("dark")
        assert not violations(page, of_colours=True), "dark"
        assert not page.problems


@pytest.fixture
def page(visitor: Page, world) -> Page:
    """A page of the operator."""
    visitor.keep_key(world.keys["admin"])
    return visitor
