"""The console in a real browser, with a real service and real maps: access, scans, recorded queries, live."""

from __future__ import annotations

import json
import os
import re
import subprocess
import zipfile
from dataclasses import replace
from datetime import datetime, timezone

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from firstfix.catalog.recorded_queries import RecordedQueries, new_query_id
from firstfix.scan.scan import Scan
from firstfix.wire.scan import encode_scan
from firstfix_cli.main import app
from firstfix_client import Client
from plugins.console.tests.accessible import violations
from plugins.console.tests.browser import HOST
from plugins.console.tests.console_world import MARKUP
from plugins.console.tests.page import CANVAS
from plugins.console.tests.pictures import GROUND, difference, place_in
from plugins.console.tests.scans import (
    change_answers,
    click_the_map,
    localized_scan,
    places_of,
    scan_colours,
    try_scan,
)
from tests.waiting import wait_until

pytestmark = pytest.mark.slow


# Access


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


# A scan


def test_a_fresh_map_offers_a_scan_to_click_at_once(page):
    """It is simulated from the map's points, so the service finds it where it was simulated."""
    page.open("#/maps/yard/try")
    page.map_picture()
    page.click("button", "Try an example scan")
    page.wait(".drop", "Simulated at")
    spot = [float(m) for m in re.findall(r"-?\d+\.\d+", page.text(".drop span"))]
    page.wait(".answer .verdict", "localized")
    page.wait(".answer .hint", "95 % ellipse")
    best = places_of(page)[0]
    found = [float(best[f"{axis} (m)"].split()[0]) for axis in "xyz"]
    assert np.linalg.norm(np.subtract(found, spot)) < 0.3


def test_a_house_that_is_smaller_than_its_surroundings_would_be_fills_the_picture(page, house):
    page.open(f"#/maps/{house}/try")
    page.map_picture()
    page.click("button", "Try an example scan")
    page.wait(".answer .verdict")
    page.wait(".map-canvas[aria-busy=false]")
    picture = page.map_picture()
    is_map = np.abs(picture.astype(int) - GROUND).max(axis=2) > 8
    rows = np.flatnonzero(is_map.sum(axis=1) > 0.05 * picture.shape[1])  # legends are no house
    assert np.ptp(rows) > 0.6 * picture.shape[0]


def test_a_scan_is_simulated_at_the_spot_that_was_clicked(page):
    page.open("#/maps/yard/try")
    page.map_picture()
    assert not page.has("button", "Simulate one at the clicked spot")
    click_the_map(page)
    page.click("button", "Simulate one at the clicked spot")
    page.wait(".drop", "Simulated at")
    page.wait(".answer .verdict", "localized")
    clicked = page.js("['x (m)', 'y (m)'].map((name) => find('input', name).valueAsNumber)")
    best = places_of(page)[0]
    found = [float(best[f"{axis} (m)"].split()[0]) for axis in "xy"]
    assert np.linalg.norm(np.subtract(found, clicked)) < 0.3


def test_a_link_to_a_simulated_scan_restores_it_and_the_pose_by_hand(page):
    page.open("#/maps/yard/try")
    page.map_picture()
    page.click("button", "Try an example scan")
    page.wait(".answer .verdict", "localized")
    page.click("button", "Place by hand")
    page.fill("x (m)", "1.25")
    page.press("Enter")
    page.click("label.check", "Lay the scan at the pose by hand")
    page.click("label.check", "Search only around it")
    # A busy page asked once for this change and the next one: two queries came, and three were waited for.
    wait_until(lambda: page.asked.count("POST /localize") == 2)
    page.fill("Within (m)", "30")
    page.js(
        "find('button', 'Turn').click()"
    )  # what is drawn meanwhile leaves the text, as when an answer comes
    page.press("Enter")
    page.wait(".answer .tag", "searched only within 30 m of the pose by hand")
    wait_until(lambda: page.asked.count("POST /localize") == 3)
    page.until("!find('[role=status]', 'Asking')")
    name, places, laid = page.text(".drop span"), places_of(page), _laid_points(page)
    page.until("location.hash.includes('spot=') && location.hash.includes('hand_use=prior')")

    page.open(page.js("location.hash"))  # as from a message
    page.wait(".answer .tag", "searched only within 30 m of the pose by hand")
    assert page.text(".drop span") == name
    wait_until(lambda: places_of(page) == places)
    assert page.js("find('input', 'x (m)').valueAsNumber") == 1.25
    assert page.js("find('input', 'Lay the scan at the pose by hand').checked")
    assert _laid_points(page) == pytest.approx(laid, rel=0.02, abs=5)  # the link has millimetres

    page.click("button", "Remove")
    page.until("!location.hash.includes('hand')")


def _laid_points(page) -> list[int]:
    """Points of the scan on the map, through it and not in it, where it is laid."""
    page.wait(".key", "not in the map")
    return [int(number) for number in re.findall(r"\d+", page.text(".key"))]


def test_a_link_to_a_recorded_query_restores_the_place_that_was_chosen(page, world):
    file, _ = _sure_of_one_of_many(world)
    several: list[str] = []
    wait_until(
        lambda: (
            several
            or several.extend(
                one["query_id"] for one in _recorded(world) if len(one["answer"]["hypotheses"]) > 1
            )
        )
    )
    page.open(f"#/maps/yard/try?recorded={several[0]}")
    page.wait(".places tr:first-child input:checked")
    page.click(".places tbody tr:nth-child(2)")
    page.until("location.hash.includes('place=')")
    page.open(page.js("location.hash"))
    page.wait(".places tbody tr:nth-child(2) input:checked")
    page.wait("[aria-label=Truth]", "Where was it really taken?")

    page.drop(
        ".panel .drop", file
    )  # another scan: what was chosen of the query goes, and nobody judges it by mistake
    page.wait(".drop", file.name)
    page.wait(".places tr:first-child input:checked")
    page.until("!/place=|recorded=/.test(location.hash) && !find('[aria-label=Truth]', '')")


def test_the_page_says_what_would_make_an_answer_localized(page, world):
    asked = ((one, world.ask(one, min_probability="0.9999")) for one, _ in world.scans)
    file, answer = next((one, found) for one, found in asked if found["reasons"] == ["low_probability"])
    try_scan(page, file)
    _ask_for(page, 0.9999)
    page.wait("h3", "What would make it localized")
    assert answer["findings"]
    for one in answer["findings"]:
        page.wait(".findings li", one["text"])
        page.wait(".findings small", one["remedy"])
    page.wait(".answer p", "A least probability below its")
    _ask_for(page, round(answer["probability"] - 0.01, 2))  # as it says
    page.wait(".verdict", "localized")
    page.until("!find('h3', 'What would make it localized')")


def test_the_other_places_of_a_scan_are_looked_at(page, world):
    file = next(file for file, _ in world.scans if len(world.ask(file)["hypotheses"]) > 1)
    try_scan(page, file)
    page.wait(".places tr:first-child input:checked")
    first, colours = page.map_picture(), scan_colours(page)
    page.click(".places tbody tr:nth-child(2) td", "%")
    page.wait(".places tbody tr:nth-child(2) input:checked")
    wait_until(lambda: difference(first, page.map_picture()) > 0.02)
    page.js("find('input', 'Place 2').focus()")
    page.press("ArrowUp")
    page.wait(".places tbody tr:first-child input:checked")
    wait_until(lambda: scan_colours(page) == colours)
    page.press("ArrowDown")
    page.wait(".places tbody tr:nth-child(2) input:checked")


def test_places_stand_side_by_side_with_the_deviations_of_the_one_that_has_them(page, world):
    file, answer = _sure_of_one_of_many(world)
    best = answer["hypotheses"][0]["T_map_sensor"]
    sigmas = np.sqrt(np.diag(np.reshape(answer["covariance"], (6, 6))))
    try_scan(page, file)
    page.wait(".verdict", "localized")
    first, *others = places_of(page)
    for axis, m, sigma_m in zip("xyz", best["position"], sigmas, strict=False):
        told = [float(number) for number in first[f"{axis} (m)"].replace("±", "").split()]
        assert told == pytest.approx([m, sigma_m], abs=0.006)
    heading_deg = Rotation.from_quat(best["quaternion"]).as_euler("ZYX", degrees=True)[0]
    told = [float(number) for number in first["Heading (°)"].replace("±", "").split()]
    assert told == pytest.approx([heading_deg, np.degrees(sigmas[5])], abs=0.06)
    assert others
    assert not any("±" in text for place in others for text in place.values())
    page.wait(".answer .hint", "95 % ellipse of place 1,")
    for width in (1024, 1240, 1254, 1266, 1280, 1330, 1348, 1360, 1440):  # about where its rows become tables
        page.size(width, 800)
        assert page.js("find('.places', '').scrollWidth <= find('.places', '').clientWidth"), width


def _sure_of_one_of_many(world):
    """A scan that is localized although its answer has other places, and the answer."""
    for file, _ in world.scans:
        answer = world.ask(file)
        if answer["verdict"] == "localized" and len(answer["hypotheses"]) > 1:
            return file, answer
    raise AssertionError("no scan is localized with other places in its answer")


def test_the_ellipse_stays_at_the_place_whose_covariance_it_is(page, world):
    """The ellipse of a good answer is as small as a pixel, so a large one is put into it on its way."""
    page.size(1280, 800)  # so many pixels that the rings hardly meet
    file, answer = _sure_of_one_of_many(world)
    x, y, z = answer["hypotheses"][0]["T_map_sensor"]["position"]
    other = [x, y, z + 10.0]  # above the yard, so that it is looked at from 25 m and not with the whole yard
    places = "const [best, ...others] = said.hypotheses; others[0].T_map_sensor.position = "
    change_answers(
        page,
        f"(() => {{ globalThis.answers = (globalThis.answers ?? 0) + 1; {places}{other};"
        " const large = said.covariance.map((_, i) => (i % 7 ? 0 : 1));"
        " const covariance = globalThis.isSure ? large : null;"
        " return { ...said, hypotheses: [best, others[0]], covariance }; })()",
    )
    pictures = []
    for is_sure in ("false", "true"):
        try_scan(page, file)
        page.wait(".key", "on the map")
        page.js(f"globalThis.isSure = {is_sure}")
        page.drop(".panel .drop", file)
        page.until(f"answers === 2 && !!find('.answer .hint', '95 % ellipse') === {is_sure}")
        page.click(".places tbody tr:nth-child(2)")
        page.wait(".places tbody tr:nth-child(2) input:checked")
        page.wait(".key", "on the map")
        pictures.append(page.map_picture())
    without, drawn = pictures
    ring = {name: _seen_ring(at, other, drawn.shape) for name, at in (("best", [x, y, z]), ("other", other))}
    changed = {name: (drawn[seen] != without[seen]).any(axis=1).mean() for name, seen in ring.items()}
    assert changed["best"] > 0.5
    assert changed["other"] < 0.1


def _seen_ring(middle, looked_at, shape):
    """(rows, columns) of the pixels of a 95 % ellipse of 1 m deviation, while the camera looks at a place."""
    eye = np.add(looked_at, [0.0, -0.7 * 25, 0.8 * 25])
    angles = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    radius_m = np.sqrt(5.991)
    seen = [
        place_in(
            np.add(middle, [radius_m * np.cos(a), radius_m * np.sin(a), 0]),
            looked_at,
            eye,
            shape[1],
            shape[0],
        )
        for a in angles
    ]
    columns, rows = np.floor(seen).astype(int).T
    return rows, columns


def test_the_least_probability_decides(page, world):
    file, _, answer = localized_scan(world)
    try_scan(page, file)
    page.wait(".verdict", "localized")
    _ask_for(page, 1.0)
    page.until("!find('.verdict', 'localized')")
    assert world.ask(file, min_probability="1.0")["verdict"] == page.text(".verdict")
    assert "is less than the 100.0 % asked for" in page.text(".answer")
    _ask_for(page, round(answer["probability"] - 0.01, 2))
    page.wait(".verdict", "localized")


def test_the_least_probability_is_that_of_the_map_until_somebody_changes_it(page, world):
    of_map = world.get("/maps/yard")["manifest"]["self_test"]["threshold"]["min_probability"]
    file, _, _ = localized_scan(world)
    try_scan(page, file)
    page.wait(".verdict", "localized")
    page.wait("label", "Least probability, of the map")
    field = "find('input', 'Least probability')"
    assert page.js(f"{field}.valueAsNumber") == of_map
    _ask_for(page, 1.0)
    page.until("!find('.verdict', 'localized')")
    page.wait("label", f"instead of the map's {of_map}")
    page.click("button", "As the map has it")
    page.wait("label", "Least probability, of the map")
    page.wait(".verdict", "localized")
    assert page.js(f"{field}.valueAsNumber") == of_map
    page.js(f"{field}.focus()")
    page.press("ArrowUp")  # the smallest step never loosens it
    page.press("Enter")
    page.until(f"{field}.valueAsNumber >= {of_map}")


def test_a_copied_command_asks_the_same(page, world):
    file, _, answer = localized_scan(world)
    try_scan(page, file)
    page.wait(".verdict", "localized")
    _ask_for(page, 0.5)
    page.until("!find('[role=status]', 'Asking')")
    page.click("button", "Copy as curl")
    page.wait("[role=status]", "curl copied")
    command = page.pasted()
    assert "min_probability=0.5" in command
    said = subprocess.run(
        ["bash", "-c", command.replace(HOST, "127.0.0.1")],  # only the browser knows the name
        cwd=file.parent,
        env={**os.environ, "FIRSTFIX_API_KEY": world.keys["reader"]},
        capture_output=True,
        check=True,
    )
    found = json.loads(said.stdout)
    assert found["verdict"] == "localized"
    assert found["T_map_sensor"] == answer["T_map_sensor"]


def test_a_file_that_is_no_scan_is_refused_in_words(page, tmp_path):
    page.expected += ["400", "422", "415"]
    strange = tmp_path / "notes.md"
    strange.write_text("nothing")
    try_scan(page, strange)
    page.wait("[role=alert]", "no field x, y, z")
    broken = tmp_path / "broken.pcd"
    broken.write_text("VERSION .7\nFIELDS x y z\n")
    page.drop(".panel .drop", broken)
    page.wait("[role=alert]", "PCD")


# Recorded queries


def test_a_recorded_query_is_looked_at_judged_and_exported(page, world, tmp_path):
    file, _, _ = localized_scan(world)
    world.ask(file)
    rng = np.random.default_rng(1)
    elsewhere = tmp_path / "elsewhere.ffscan"
    elsewhere.write_bytes(encode_scan(Scan.from_points(rng.uniform(-6, 6, (4000, 3)))))
    assert world.ask(elsewhere)["verdict"] == "rejected"
    wait_until(lambda: {one["answer"]["verdict"] for one in _recorded(world)} >= {"localized", "rejected"})

    page.open("#/recorded-queries")
    page.choose("Map", "yard")
    page.wait("th[aria-sort=descending]", "When")
    verdicts = "[...document.querySelectorAll('td[data-name=Verdict]')].map((e) => e.innerText)"
    for order, is_down in (("ascending", False), ("descending", True)):
        page.click("th button", "Verdict")
        page.wait(f"th[aria-sort={order}]", "Verdict")
        listed = page.js(verdicts)
        assert set(listed) >= {"localized", "rejected"}
        assert listed == sorted(listed, reverse=is_down)

    page.choose("Verdict", "rejected")
    page.until("!find('td .verdict', 'localized') && !!find('td .verdict', 'rejected')")
    page.click("tr a", "Look")
    page.wait(".answer .verdict", "rejected")
    page.click("button", "Not in this map")
    page.wait("[role=status]", "Noted")

    page.open("#/recorded-queries")
    page.choose("Map", "yard")
    page.wait("td", "not in the map")
    page.choose("Verdict", "localized")
    page.until("!find('td .verdict', 'rejected')")
    page.click("tr a", "Look")
    page.wait(".answer .verdict", "localized")
    page.click("button", "At the place shown")
    page.wait("[role=status]", "Noted")

    page.open("#/recorded-queries")
    page.choose("Map", "yard")
    page.wait("td", "known")
    page.click("button", "Export")
    with zipfile.ZipFile(page.downloaded("yard-test-set.zip")) as archive:
        archive.extractall(tmp_path / "set")
    command = ["evaluate", str(tmp_path / "set/poses.csv"), "--map", "yard", "--json", "-"]
    command += ["--store", world.service.settings.store]
    said = CliRunner().invoke(app, command)
    assert said.exit_code == 0, said.output
    figures = json.loads(said.output)
    assert figures["n"] == 2, figures


def _recorded(world):
    return world.get("/recorded-queries", map_id="yard", limit=1000)["queries"]


# Live


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
    before = {one["query_id"] for one in _recorded(world)}
    world.ask(file)
    new: list[str] = []
    wait_until(lambda: new or new.extend({one["query_id"] for one in _recorded(world)} - before))
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


# Good manners


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
    wait_until(lambda: _recorded(world))
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
        wait_until(lambda: _recorded(world))
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


def _ask_for(page, least: float) -> None:
    page.fill("Least probability", str(least))
    page.press("Enter")
