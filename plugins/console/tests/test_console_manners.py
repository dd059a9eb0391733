"""The console in a real browser: refusals, names with markup, the keyboard alone, phones, dark and light."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import datetime, timezone

import pytest

from firstfix.catalog.recorded_queries import RecordedQueries, new_query_id
from plugins.console.tests.accessible import violations
from plugins.console.tests.console_world import MARKUP
from plugins.console.tests.page import CANVAS
from plugins.console.tests.scans import (
    localized_scan,
)
from tests.waiting import wait_until

pytestmark = pytest.mark.slow


def _refuse(page, method: str, path: str, times: int) -> None:
    """Lets the service seem to refuse requests of the next page. ``refused`` counts them."""
    detail = json.dumps({"code": "rate_limited", "detail": "too many of them: try again in 0.2 s"})
    refusal = f"new Response({json.dumps(detail)}, {{status: 429, headers: {{'Retry-After': '1'}}}})"
    page.call(
        "Page.addScriptToEvaluateOnNewDocument",
        source="globalThis.refused = 0; globalThis.ask = globalThis.fetch;"
        f"globalThis.fetch = (url, given) => given?.method === '{method}' && url.pathname === '{path}'"
        f" && refused < {times} && ++refused ? Promise.resolve({refusal}) : ask(url, given)",
    )


def test_a_view_waits_for_a_service_that_refuses_for_a_while(page):
    _refuse(page, "GET", "/maps", times=2)
    page.open()
    page.wait("a", "yard")
    assert page.js("refused") == 2
    assert "too many" not in page.text()


def test_what_a_person_asks_for_is_refused_in_words_and_at_once(page):
    _refuse(page, "POST", "/keys", times=100)
    page.open("#/keys")
    page.click("button", "Make a key")
    page.fill("Name of its owner", "hasty")
    page.click("button", "Make it")
    page.wait("dialog [role=alert]", "too many of them: try again in 0.2 s")
    assert page.js("refused") == 1


def test_names_with_markup_stay_text(visitor, world):
    page, file = visitor, localized_scan(world)[0]
    page.keep_key(world.keys["token"])
    page.open("#/live?map=yard")
    page.wait("[role=status]", "Connected")
    world.ask(file, "token")
    page.wait(".fixes td", f"jwt:{MARKUP}")
    page.map_picture()
    assert page.text(".caller .who") == f"jwt:{MARKUP}"
    assert page.count("img") == 0

    # The service records no such texts, so this record was written by another program.
    stored = RecordedQueries(world.service.catalog.store)
    wait_until(lambda: world.recorded())
    plain = next(one for one in stored.each() if one.map_id == "yard")
    texts = dict.fromkeys(("transport", "request_id", "trace_id", "media_type", "service_version"), MARKUP)
    answer = {**plain.answer, "reasons": [MARKUP], "verdict": MARKUP}
    query_id = new_query_id("0" * 8, datetime.now(timezone.utc))
    strange = replace(plain, query_id=query_id, map_id=f"yard,{MARKUP}", answer=answer, **texts)
    stored.put(strange, stored.body(plain.query_id))
    try:
        page.open("#/recorded-queries?map=yard")
        page.wait("td", f"yard,{MARKUP}")
        page.wait("td .verdict", MARKUP)
        page.map_picture()
        assert page.count("img") == 0
    finally:
        stored.delete(query_id)


def test_the_console_is_used_with_the_keyboard_alone(page):
    page.open()
    page.wait("a", "yard")
    _tab_to(page, "a", "yard")
    page.press("Enter")
    page.map_picture()
    _tab_to(page, "canvas")
    page.press("ArrowUp")
    page.until("location.hash.includes('view=')")
    _tab_to(page, "input", "Templates")
    page.press("Space")
    page.until("find('input', 'Templates').checked")
    page.open()
    page.wait("button", "Build a map")
    _tab_to(page, "button", "Build a map")
    page.press("Enter")
    page.choose("Sensor of the robots", "vlp-16")
    page.wait("dialog svg[role=img]")
    assert not violations(page)
    assert page.js("!!document.activeElement.closest('dialog')")
    page.press("Escape")
    page.until("!document.querySelector('dialog')")
    assert page.js("document.activeElement === find('button', 'Build a map')")


def test_a_scan_is_tried_and_a_version_activated_and_rolled_back_with_the_keyboard(
    page, world, coarse_version, small_version
):
    publish = world.service.catalog.publish
    old, new = (publish("by-keys", one.directory, one.manifest) for one in (coarse_version, small_version))
    page.open()
    page.wait("a", "by-keys")
    _tab_to(page, "th a", "by-keys")
    page.press("Enter")
    page.map_picture()
    _tab_to(page, "input", "Where a robot finds itself")
    page.press("Space")
    page.wait("[aria-label='Colours of the places']", "half")
    _tab_to(page, ".bar a", "Try")
    page.press("Enter")
    page.map_picture()
    page.wait("button", "Try an example scan")
    _tab_to(page, "button", "Try an example scan")
    page.press("Enter")
    page.wait(".answer .verdict", "localized")

    _tab_to(page, ".bar a", "Versions")
    page.press("Enter")
    row = f"tr:has([aria-label='Compare {old[:12]}']) button"
    page.wait(row, "Activate")
    _tab_to(page, row, "Activate")
    page.press("Enter")
    page.wait("dialog", "in place of")
    for _ in range(7):
        page.press("Tab")
        assert page.js(
            "document.activeElement === document.body || !!document.activeElement.closest('dialog')"
        )
    _tab_to(page, "dialog button", "Stay with")
    page.press("Enter")
    page.until("!document.querySelector('dialog')")
    assert page.js(f"document.activeElement === find({json.dumps(row)}, 'Activate')"), "the focus is back"
    assert world.get("/maps/by-keys")["active_version"] == new
    page.press("Enter")
    page.wait("dialog", "in place of")
    _tab_to(page, "dialog button", "Activate")
    page.press("Enter")
    page.wait("[role=status]", "Activated")
    assert world.get("/maps/by-keys")["active_version"] == old
    _tab_to(page, "header button", "Roll back")
    page.press("Enter")
    page.wait("dialog", "The version that was active before")
    _tab_to(page, "dialog button", "Roll back")
    page.press("Enter")
    page.wait("[role=status]", "Rolled back")
    assert world.get("/maps/by-keys")["active_version"] == new


def _tab_to(page, selector: str, words: str = "") -> None:
    for _ in range(60):
        page.press("Tab")
        if page.js(f"document.activeElement === find({json.dumps(selector)}, {json.dumps(words)})"):
            return
    raise AssertionError(f"the Tab key does not lead to {selector} {words!r}")


@pytest.mark.parametrize(
    "view", ["maps/yard/try", "live?map=yard", "maps/yard", "recorded-queries", "", "maps/yard/versions"]
)
def test_a_phone_shows_a_view_without_scrolling_sideways(page, world, view):
    page.size(390, 844, phone=True)
    if view == "recorded-queries":
        world.ask(localized_scan(world)[0])
        wait_until(lambda: world.recorded())
    page.open(f"#/{view}")
    page.wait("td .verdict" if view == "recorded-queries" else "h1, h2")
    if "yard" in view and "versions" not in view:
        page.map_picture()
        assert page.box(CANVAS)[3] > 200
    if view == "maps/yard/try":
        page.drop(".panel .drop", localized_scan(world)[0])
        page.wait(".verdict", "localized")
        page.click(".places tbody tr:last-child")
        page.wait(".places tbody tr:last-child input:checked")
    page.until("document.documentElement.scrollWidth <= 390 && document.body.scrollWidth <= 390")


def test_dark_and_light_follow_the_system(page):
    page.open()
    page.wait("a", "yard")
    brightness = {}
    for scheme in ("light", "dark"):
        page.prefers(scheme)
        brightness[scheme] = page.picture().mean()
    assert brightness["light"] > 200
    assert brightness["dark"] < 60
