"""The console in a real browser: robots and alerts of the view Live."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.scan.scan import Scan
from firstfix.wire.scan import encode_scan
from firstfix_client import Client
from plugins.console.tests.scans import (
    localized_scan,
)
from tests.waiting import wait_until

pytestmark = pytest.mark.slow


def test_a_robot_that_is_seldom_localized_has_an_alert_with_a_link(page, world, tmp_path):
    few = tmp_path / "few.ffscan"
    few.write_bytes(encode_scan(Scan.from_points(np.eye(3) * 5)))
    page.open("#/live?map=yard")
    page.wait("[role=status]", "Connected")
    for _ in range(12):
        assert world.ask(few, "reader")["verdict"] == "rejected"
    page.click(".alerts a", "answers were localized")
    page.wait(".alerts a[aria-current=true]", "answers were localized")
    assert page.has(".robots tr.shown-robot .verdict", "rejected")
    address = page.js("location.hash")
    page.open(address)  # as from a message
    page.wait(".alerts a[aria-current=true]", "answers were localized")
    assert page.has(".robots th", "a robot"), "the name of its key"
    page.open("#/live?map=yard&alert=silent%3Anobody")
    page.wait(".alerts li", "silent:nobody, is over")


def test_robots_behind_one_key_have_a_row_each_on_the_map_that_was_asked_last(page, world, house):
    page.size(1440, 900)
    file, _, _ = localized_scan(world)
    for robot in ("/hall/cart-07", "/hall/cart-12"):
        headers = {
            "X-Robot": robot,
            "Content-Type": "application/vnd.firstfix.scan",
            **world.headers("reader"),
        }
        asked = world.service.http.post("/localize?map=yard", content=file.read_bytes(), headers=headers)
        assert asked.json()["verdict"] == "localized"
    page.open("#/live")
    page.until(
        "find('select', '')?.value === 'yard'", "the map that was asked, and not the first of the alphabet"
    )
    for robot in ("/hall/cart-07", "/hall/cart-12"):
        page.wait(".robots th", robot)
        page.wait(".fixes td", robot)
    page.map_picture()
    canvas, panel = page.box(".map-canvas"), page.box(".panel")
    assert canvas[0] == 0, "the map is at the left"
    assert canvas[3] > 0.9 * 900, "as high as the window below the bar"
    assert panel[0] >= canvas[2] - 1, "the list is at the right"
    ago_s = 3600
    page.js(f"{{ const now = Date.now; Date.now = () => now() + {ago_s * 1000}; }}")
    page.wait(".robots small", "60 min ago")
    assert not page.has(".alerts li", "/hall/cart"), "a robot that has its fix may rest"


def test_answers_that_somebody_judged_wrong_have_alerts_until_they_are_judged_right(page, world, tmp_path):
    file, _, answer = localized_scan(world)
    right = answer["T_map_sensor"]
    x, y, z = right["position"]
    off = {**right, "position": [x + 12.0, y, z]}
    elsewhere = tmp_path / "elsewhere.ffscan"
    points_m = np.random.default_rng(1).uniform(-6, 6, (4000, 3))
    elsewhere.write_bytes(encode_scan(Scan.from_points(points_m)))
    page.hasten()
    page.open("#/live?map=yard")
    page.wait("[role=status]", "Connected")
    localized, rejected = _newly_kept(world, file), _newly_kept(world, elsewhere)
    try:
        _judge(world, localized, off)
        page.wait(".alerts li", "is 12.0 m and 0° off the place that was told")  # without a reload
        _judge(world, rejected, right)
        page.wait(".alerts li", "was rejected, and its scan was taken in this map")
        page.click(".alerts a", "False: an answer of")
        page.wait(".alerts a[aria-current=true]", "False: an answer")
        address = page.js("location.hash")
        assert localized in address
        page.open(address)  # as from a message
        page.wait(".alerts a[aria-current=true]", "False: an answer")
        page.js("find('.alerts li', 'False: an answer').querySelector('a:last-child').focus()")
        page.press("Enter")
        page.wait("[aria-label=Truth]", "Where was it really taken?")
        assert localized in page.js("location.hash")

        _judge(world, localized, right)
        page.open(address)
        page.wait(".alerts li", f"false:{localized}, is over")
        page.wait(".alerts li", "Disputed: an answer")
    finally:
        for query_id in (localized, rejected):
            world.service.http.delete(f"/recorded-queries/{query_id}", headers=world.headers("admin"))


def _newly_kept(world, file) -> str:
    """The id of the query that the service records when it is asked about a scan now."""
    before = {one["query_id"] for one in world.recorded()}
    world.ask(file)
    new: list[str] = []
    wait_until(lambda: new or new.extend({one["query_id"] for one in world.recorded()} - before))
    (query_id,) = new
    return query_id


def _judge(world, query_id, T_map_sensor) -> None:
    truth = {"map_id": "yard", "T_map_sensor": T_map_sensor}
    url = f"/recorded-queries/{query_id}/truth"
    assert world.service.http.put(url, json=truth, headers=world.headers("admin")).is_success


def test_a_build_of_the_map_that_failed_has_an_alert_with_a_link(page, world, tmp_path):
    broken = tmp_path / "broken.ply"
    broken.write_bytes(b"ply\nformat ascii 1.0\nelement vertex 1000000\n")
    page.hasten()
    page.open("#/live?map=yard")
    page.wait("[role=status]", "Connected")
    with Client(world.service.url, api_key=world.keys["admin"]) as client:
        build_id = client.build_map(broken, "yard", config={"sensor": "vlp-16"}).build_id
    try:
        page.click(".alerts a", "The build of just now failed: ")
        page.wait(".alerts a[aria-current=true]", world.get(f"/builds/{build_id}")["error"]["detail"])
        assert build_id in page.js("location.hash")
        page.js("find('.alerts li', 'The build').querySelector('a:last-child').focus()")
        page.press("Enter")
        page.wait(".builds li", "yard")
        page.click(".builds button", "Hide")  # it was read
        page.open(f"#/live?map=yard&alert=build%3A{build_id}")
        page.wait(".alerts li", f"build:{build_id}, is over")
    finally:
        store = world.service.catalog.store
        for key in store.list(f"builds/{build_id}"):
            store.delete(key)
