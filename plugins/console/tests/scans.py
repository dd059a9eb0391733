"""Scans in the view that tries them: what a person drops, and what the page then says."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firstfix.transform import Matrix
from plugins.console.tests.page import CANVAS
from plugins.console.tests.pictures import AGREES, CONTRADICTS, pixels_of

if TYPE_CHECKING:
    from plugins.console.tests.console_world import ConsoleWorld
    from plugins.console.tests.page import Page


def try_scan(page: Page, file: Path, map_id: str = "yard") -> None:
    """Drops a scan file in the view that tries it."""
    page.open(f"#/maps/{map_id}/try")
    page.map_picture()
    page.drop(".panel .drop", file)


def scan_colours(page: Page) -> tuple[int, int]:
    """Pixels of points that agree and that contradict, once the scan is laid over the map."""
    page.wait(".key", "on the map")
    picture = page.map_picture()
    return pixels_of(picture, AGREES), pixels_of(picture, CONTRADICTS)


def localized_scan(world: ConsoleWorld) -> tuple[Path, Matrix, dict[str, Any]]:
    """A scan that the yard's service localizes: (file, T_map_sensor, answer)."""
    for file, T_map_sensor in world.scans:
        answer = world.ask(file)
        if answer["verdict"] == "localized":
            return file, T_map_sensor, answer
    raise AssertionError("no scan of the yard is localized")


def said_chance(text: str) -> float:
    """The first probability in a text of the page, 0 to 1. It is never rounded up to 1."""
    found = re.search(r"([\d.]+) %", text)
    assert found, text
    return float(found[1]) / 100


def places_of(page: Page) -> list[dict[str, str]]:
    """The table of places as it is read: each row by the names of its columns."""
    page.wait(".places tbody tr")
    rows: list[list[str]] = page.js(
        "[...document.querySelectorAll('.places tr')]"
        ".map((row) => [...row.cells].map((cell) => cell.innerText.trim()))"
    )
    return [dict(zip(rows[0], row, strict=True)) for row in rows[1:]]


def change_answers(page: Page, changed: str) -> None:
    """Changes answers on their way to the page: ``changed`` is an object, in JavaScript, of ``said``."""
    page.call(
        "Page.addScriptToEvaluateOnNewDocument",
        source="globalThis.ask = globalThis.fetch; globalThis.fetch = async (url, given) => {"
        " const answer = await ask(url, given); if (url.pathname !== '/localize') return answer;"
        f" const said = await answer.json(); return Response.json({changed}); }}",
    )


def click_the_map(page: Page) -> None:
    """Clicks a point of the cloud near the middle of the picture, which begins a pose by hand."""
    x, y, width, height = page.box(f"{CANVAS} canvas")
    for dx, dy in ((0, 0), (40, 30), (-60, 40), (30, -60)):  # one of them is on a point
        page.click_at(x + width / 2 + dx, y + height / 2 + dy)
        if page.has("[aria-label='A pose by hand']"):
            return
    raise AssertionError("no click was on a point of the map")
