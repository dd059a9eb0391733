"""The console in a real browser: what a key may do, and the keys themselves."""

from __future__ import annotations

import pytest

from plugins.console.tests.console_world import MARKUP
from tests.waiting import wait_until

pytestmark = pytest.mark.slow


def test_what_a_key_may_not_do_is_not_shown(visitor, world):
    visitor.keep_key(world.keys["reader"])
    visitor.open()
    visitor.wait("td", world.versions[1][:12])
    assert visitor.has("a", "Try a scan")
    for words in ("Build a map", "Delete", "Recorded queries", "Live", "API keys"):
        assert not visitor.has("button, a", words), words
    visitor.expected += ["403"]
    for view in ("recorded-queries", "live", "keys"):
        visitor.open(f"#/{view}")
        visitor.wait("[role=alert]", "scope")


def test_the_views_of_an_empty_service_say_what_to_do_next(visitor, world):
    visitor.keep_key(world.keys["stranger"])
    visitor.open()
    visitor.wait(".empty", "Build one from a cloud")
    visitor.open("#/recorded-queries")
    visitor.wait(".empty", "100 % of the queries that it cannot localize, and there was none yet")
    visitor.open("#/live")
    visitor.wait(".empty", "Build one")
    visitor.open(f"#/{MARKUP}")
    visitor.wait(".empty a", "All maps")


def test_keys_are_made_and_revoked(page, world):
    page.open("#/keys")
    page.click("button", "Make a key")
    page.fill("Name of its owner", MARKUP)
    page.click("button", "Make it")
    page.wait("output.token")
    headers = {"Authorization": f"Bearer {page.text('output.token')}"}
    page.click("button", "Copy")
    assert f"Bearer {page.pasted()}" == headers["Authorization"]
    wait_until(lambda: world.service.http.get("/caller", headers=headers).status_code == 200)
    page.click("button", "Done")
    page.wait("th", MARKUP)
    assert page.count("img") == 0
    page.click("button", f"Revoke the key of {MARKUP}")
    page.wait("dialog", "robots with it are not answered any more")
    assert page.js("find('dialog button', 'Revoke').disabled")
    assert page.count("img") == 0
    assert not page.has("tr .tag", "revoked")
    page.fill("Type the name of its owner", MARKUP)
    page.click("dialog button", "Revoke")
    page.wait("tr .tag", "revoked")
    wait_until(lambda: world.service.http.get("/caller", headers=headers).status_code == 401)


def test_a_key_that_is_revoked_in_use_leads_to_the_sign_in_and_back(visitor, world):
    visitor.expected += ["401"]
    headers = world.headers("admin")
    wanted = {"name": "leaving", "scopes": ["build"], "maps": ["*"]}
    made = world.service.http.post("/keys", json=wanted, headers=headers).json()
    visitor.open("#/live?map=yard")
    visitor.fill("API key or token", made["token"])
    visitor.press("Enter")
    visitor.wait("[role=status]", "Connected")
    visitor.map_picture()
    assert world.service.http.delete(f"/keys/{made['key_id']}", headers=headers).is_success
    visitor.wait(".sign-in [role=alert]", "no such API key, or it was revoked")
    assert visitor.js("location.hash") == "#/live?map=yard"
    assert visitor.js("sessionStorage.length") == 0
    asked = visitor.asked.count("GET /answers/events")

    visitor.fill("API key or token", world.keys["admin"])
    visitor.press("Enter")
    visitor.wait("[role=status]", "Connected")
    visitor.map_picture()
    assert visitor.asked.count("GET /answers/events") == asked + 1
    assert not visitor.has("[role=alert]")
