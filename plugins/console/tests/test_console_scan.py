"""The console in a real browser: a scan is tried, and its answer read."""

from __future__ import annotations

import json
import os
import re
import subprocess

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plugins.console.tests.browser import HOST
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
                one["query_id"] for one in world.recorded() if len(one["answer"]["hypotheses"]) > 1
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


def _ask_for(page, least: float) -> None:
    page.fill("Least probability", str(least))
    page.press("Enter")
