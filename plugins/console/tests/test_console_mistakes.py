"""The console in a real browser: what it lets nobody believe, and what nobody may do by one click."""

from __future__ import annotations

import json

import numpy as np
import pytest

from firstfix.scan.scan import Scan
from firstfix.wire.scan import decode_scan, encode_scan
from plugins.console.tests import browser as browsers
from plugins.console.tests.accessible import violations
from plugins.console.tests.pictures import AGREES, HINT, difference, pixels_of
from plugins.console.tests.scans import (
    change_answers,
    click_the_map,
    localized_scan,
    places_of,
    said_chance,
    scan_colours,
    try_scan,
)
from tests.service.service_world import running_service
from tests.waiting import let_pass, wait_until

pytestmark = pytest.mark.slow

PHONE = (390, 844)


@pytest.fixture
def points_m(world):
    """(n, 3) The points of a scan that the yard's service localizes."""
    return decode_scan(localized_scan(world)[0].read_bytes()).points


@pytest.fixture(scope="module")
def many_places(world):
    """A scan whose answer has many places, and their number."""
    numbers = {file: len(world.ask(file)["hypotheses"]) for file, _ in world.scans}
    return max(numbers.items(), key=lambda one: one[1])


# A scan and its answer


def test_a_file_that_cannot_be_read_takes_the_answer_before_it_away(page, world, tmp_path):
    page.expected += ["400", "422", "415"]
    strange, broken = tmp_path / "notes.md", tmp_path / "broken.pcd"
    strange.write_text("nothing")
    broken.write_text("VERSION .7\nFIELDS x y z\n")
    for file, words in ((strange, "no field x, y, z"), (broken, "PCD")):
        try_scan(page, localized_scan(world)[0])
        assert scan_colours(page)[0] > 200
        page.drop(".panel .drop", file)
        page.wait("[role=alert]", words)
        page.until("!find('.verdict', '') && !find('.key', '')")
        wait_until(lambda: pixels_of(page.map_picture(), AGREES) == 0)


def test_a_scan_that_has_no_place_is_not_laid_over_the_map(page, world, tmp_path):
    few = tmp_path / "few.ffscan"
    few.write_bytes(encode_scan(Scan.from_points(np.eye(3) * 5)))
    try_scan(page, localized_scan(world)[0])
    assert scan_colours(page)[0] > 200
    page.drop(".panel .drop", few)
    page.wait(".verdict", "rejected")
    wait_until(lambda: pixels_of(page.map_picture(), AGREES) == 0)
    assert not page.has(".key", "on the map")
    assert not page.has("h3", "Places")


def test_the_places_add_up_and_are_in_the_order_of_what_is_printed(page, world, many_places):
    file, number = many_places
    try_scan(page, file)
    page.wait(".places tbody tr")
    if number > 8:
        page.click("button", f"All {number} places")
    page.until(f"document.querySelectorAll('.places tbody tr').length === {number}")
    texts = [place["Probability"] for place in places_of(page)]
    shares = [0.0 if text.startswith("under") else said_chance(text) for text in texts]
    assert shares == sorted(shares, reverse=True)
    assert sum(shares) < 1.001 + 0.0005 * number
    assert all(-180 <= float(place["Heading (°)"].split()[0]) <= 180 for place in places_of(page))


def test_other_places_are_hidden_from_the_map(page, many_places):
    try_scan(page, many_places[0])
    scan_colours(page)
    before = page.map_picture()
    page.click("label.check", "Show the other places on the map")
    wait_until(lambda: difference(before, page.map_picture()) > 0)


def test_an_answer_says_where_to_take_the_next_scan(page, world):
    """None of the yard's scans is ambiguous, so the hint is put into an answer on its way."""
    goal = {"position": [2.0, 1.0, 0.0], "quaternion": [0, 0, 0, 1]}
    hint = {
        "T_sensor_goal": goal,
        "distance_m": 2.24,
        "turn_deg": -30,
        "separation": 0.5,
        "tells_apart": [0, 1],
    }
    change_answers(page, f"{{ ...said, hint: globalThis.told ? {json.dumps(hint)} : null }}")
    file = localized_scan(world)[0]
    try_scan(page, file)
    scan_colours(page)
    assert pixels_of(page.map_picture(), HINT) == 0
    page.js("globalThis.told = true")
    page.drop(".panel .drop", file)
    page.wait("[role=note]", "drive 2.2 m along the blue arrow, turn 30° to the right")
    wait_until(lambda: pixels_of(page.map_picture(), HINT) > 20)


def test_a_pose_by_hand_guides_the_search_only_if_somebody_says_so(page, world):
    try_scan(page, localized_scan(world)[0])
    scan_colours(page)
    asked = page.asked.count("POST /localize")
    click_the_map(page)
    page.wait("[aria-label='A pose by hand'] label.check", "Search only around it")
    let_pass(1.0)
    assert page.asked.count("POST /localize") == asked
    page.click("label.check", "Search only around it")
    page.wait(".answer .tag", "searched only within 5 m of the pose by hand")
    wait_until(lambda: page.asked.count("POST /localize") == asked + 1)


def test_a_scan_of_any_program_is_sent_as_it_is(page, points_m, tmp_path):
    page.expected += ["429"]  # a LAS is read by a process of its own, and a caller looks at few scans at once
    laspy = pytest.importorskip("laspy")
    las = laspy.LasData(laspy.LasHeader(version="1.2", point_format=0))
    las.header.scales = [0.001] * 3
    las.x, las.y, las.z = points_m.T.astype(float)
    for name in ("scan.las", "scan.laz"):
        las.write(str(tmp_path / name))
    np.save(tmp_path / "scan.npy", points_m.astype(np.float64))
    np.savetxt(tmp_path / "scan.xyz", points_m, fmt="%.4f")
    with_names = np.column_stack([np.zeros(len(points_m)), points_m])
    np.savetxt(tmp_path / "scan.csv", with_names, fmt="%.4f", delimiter=",", header="i,x,y,z", comments="")
    (tmp_path / "scan.dat").write_bytes((tmp_path / "scan.npy").read_bytes())
    page.open("#/maps/yard/try")
    for name in ("scan.las", "scan.laz", "scan.npy", "scan.xyz", "scan.csv", "scan.dat"):
        page.drop(".panel .drop", tmp_path / name)
        page.wait(".drop", name)
        page.wait(".verdict", "localized")
        page.wait(".understood", "fields")

    page.click("button", "Copy as curl")
    page.wait("pre.code", "--data-binary '@scan.dat'")


def test_a_file_that_is_no_scan_is_refused_in_the_services_words(page, points_m, tmp_path):
    page.expected += ["400", "415"]
    np.save(tmp_path / "turned.npy", points_m.T)
    (tmp_path / "scan.laz").write_bytes(b"LASF")
    (tmp_path / "drive.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(100))
    (tmp_path / "commas.csv").write_text("1,5;2,5;3,5\n")
    page.open("#/maps/yard/try")
    for name, words in (
        ("turned.npy", f"(3, {len(points_m)})"),
        ("scan.laz", "LAS"),
        ("drive.mcap", "`firstfix localize --bag` takes it"),
        ("commas.csv", "write numbers with a point"),
    ):
        page.drop(".panel .drop", tmp_path / name)
        page.wait("[role=alert]", words)
        assert not page.has(".verdict")
        page.until("document.querySelectorAll('[role=alert]').length === 1", "said once")


def test_a_recorded_query_is_there_to_try(page, world):
    world.ask(localized_scan(world)[0])
    wait_until(lambda: world.get("/recorded-queries", map_id="yard")["queries"])
    page.open("#/maps/yard/try")
    page.wait("select", "Or one that a robot asked")
    page.js(
        "{ const list = find('select', 'Or one that a robot asked'); list.selectedIndex = 1;"
        " list.dispatchEvent(new Event('change', { bubbles: true })); }"
    )
    page.wait(".verdict")
    page.wait(".drop", "Recorded query of")


# Maps


def test_the_quality_of_a_map_is_what_its_self_test_localized(page, world):
    test = world.get("/maps/yard")["manifest"]["self_test"]
    localized = f"{100 * test['localized']:.0f} %"
    page.open()
    page.wait("tr", "yard")
    page.wait("tr td strong", localized)
    page.open("#/maps/yard")
    page.wait("[aria-label='Is it good?'] .grade")
    facts = page.text("[aria-label='Is it good?']")
    for words in (
        f"{localized} of {test['queries']} scans",
        "Sure and wrong",
        "Sensor",
        "Templates",
        "Median error",
    ):
        assert words in facts, words
    page.open("#/maps/yard/versions")
    page.wait("tr td strong", localized)


def test_the_list_of_maps_says_what_happens_and_what_needs_a_person(page, world, coarse_version, tmp_path):
    world.service.catalog.publish("lost", coarse_version.directory, coarse_version.manifest)
    few = tmp_path / "few.ffscan"
    few.write_bytes(encode_scan(Scan.from_points(np.eye(3) * 5)))
    page.open()
    page.wait("tr:has([href='#/maps/lost']) td", "none")
    page.until("document.querySelector('.thumbnail img')?.naturalWidth > 0")
    assert not page.has(".needs li", "lost")
    for _ in range(6):
        world.ask(few, map="lost")
    page.wait("tr:has([href='#/maps/lost']) td", "6 0 % localized")  # without a reload
    page.wait(".needs li", "lost 6 of 6 queries of the last hour were not localized")
    page.click(".needs [href='#/recorded-queries?map=lost']", "Look")
    page.until("location.hash === '#/recorded-queries?map=lost'")
    page.map_picture()  # its points are read
    assert world.service.http.delete("/maps/lost", headers=world.headers("admin")).is_success


def test_a_build_does_not_take_the_place_of_a_map_unnoticed(page, tmp_path):
    file = tmp_path / "yard.ply"
    file.write_bytes(b"ply\n")
    page.open()
    page.wait("a", "yard")
    page.click("button", "Build a map")
    page.drop("dialog .drop", file)
    page.until("find('input', 'Name of the map').value === 'yard-2'")
    assert not page.has("dialog [role=alert]")
    page.fill("Name of the map", "yard")
    page.wait("dialog [role=alert]", "unless its self-test fails")
    page.choose("Sensor of the robots", "vlp-16")
    page.click("dialog button.primary", "Build")
    let_pass(0.5)
    assert not any(one.startswith("POST") for one in page.asked), page.asked
    assert page.has("dialog select", "Axis of the file that points up")
    assert page.js("find('dialog select', 'Sensor of the robots').required")


def test_a_sensor_of_ones_own_is_handed_in_as_a_file(page, world, house_file, tmp_path):
    own = tmp_path / "own.yaml"
    own.write_text("# ours\nname: ours\nelevations_deg: [-10, 0, banana]\n")
    page.expected += ["400", "422"]
    page.open()
    page.click("button", "Build a map")
    page.drop("dialog .drop", house_file)
    page.wait("dialog .drop", "house.ply")
    page.fill("Name of the map", "own-sensor")
    page.choose("Sensor of the robots", "another one: a YAML or JSON file")
    page.give_file("dialog input[accept*=yaml]", own)
    page.choose("Axis of the file that points up", "y, as usual in graphics")
    page.click("dialog button.primary", "Build")
    page.wait("dialog [role=alert]", "banana")  # the service has read it
    assert not any(one["map_id"] == "own-sensor" for one in world.get("/builds")["builds"])


def test_a_layer_that_has_nothing_to_show_says_so(page):
    page.open("#/maps/yard?layers=trajectory,localizability")
    page.wait("label.check [role=status]", "this version was built without one")
    page.wait("[aria-label='Colours of the places'] figcaption", "Scans of the self-test that were localized")


def test_an_address_of_no_map_leads_back_to_the_maps(page):
    page.expected += ["404"]
    for view in ("", "/try", "/versions"):
        page.open(f"#/maps/nope{view}")
        page.wait(".empty", "There is no map nope")
        page.until("!find('.bar a', 'Versions')")
        assert not page.has(".empty", "Did you mean")
    page.open("#/maps/yart/try")
    page.click(".empty a", "yard")  # the one that was meant
    page.wait("h1, h2", "yard")
    page.open("#/maps/nope")
    page.click(".empty a", "All maps")
    page.wait("a", "yard")
    for address, words in (("", "Maps"), ("maps/yard", "yard"), ("maps/yard/try", "Try")):
        page.open(f"#/{address}")
        page.wait(".bar a[aria-current=page]", words)
        assert page.count(".bar a[aria-current=page]") == 1


def test_the_picture_of_a_map_is_moved_by_keys_that_it_names(page):
    page.open("#/maps/yard")
    before = page.map_picture()
    page.js("document.querySelector('canvas').focus()")
    page.wait(".map-canvas .keys", "Arrow keys move it")
    page.press("ArrowLeft")
    wait_until(lambda: difference(before, page.map_picture()) > 0.01)
    page.open("#/maps/yard")
    page.wait("canvas")
    page.press("Tab")
    page.wait(".skip:focus", "Skip to the view")
    page.press("Enter")
    page.until("document.activeElement.id === 'view'")


def test_the_number_of_points_is_read_on_the_dark_picture(page):
    for scheme in ("light", "dark"):
        page.prefers(scheme)
        page.open("#/maps/yard")
        page.wait(".shown", "points")
        red, green, blue = json.loads(
            page.js(
                "JSON.stringify(getComputedStyle(document.querySelector('.shown')).color.match(/[\\d.]+/g)"
                ".slice(0, 3).map(Number))"
            )
        )
        assert 0.2126 * red + 0.7152 * green + 0.0722 * blue > 150, scheme


# What nobody may do by one click: versions, builds and keys are in the tests of their views.


def test_a_recorded_query_is_removed_only_after_a_question(page, world):
    """Queries are recorded after their answers: the row that goes may be one that was not there before.

    So the page's own request says which one went.
    """

    def recorded() -> set[str]:
        return {one["query_id"] for one in world.get("/recorded-queries", limit=1000)["queries"]}

    def removed() -> list[str]:
        return [one.rsplit("/", 1)[-1] for one in page.asked if one.startswith("DELETE /recorded-queries/")]

    earlier = recorded()
    world.ask(localized_scan(world)[0])
    wait_until(lambda: recorded() - earlier)
    before = recorded()
    page.open("#/recorded-queries?map=yard")
    page.click("tr button", "Remove")
    page.wait("dialog", "It cannot be brought back")
    page.press("Escape")
    page.until("!document.querySelector('dialog')")
    assert removed() == []
    page.click("tr button", "Remove")
    page.click("dialog button", "Remove for good")
    wait_until(removed)
    (gone,) = removed()
    wait_until(lambda: gone not in recorded())
    assert recorded() >= before - {gone}


# A service that asks nobody


def test_a_service_that_is_open_to_everyone_says_so(browser, tmp_path):
    with running_service(tmp_path, load=None, zenoh=False, workers=1, auth="off") as service:
        port = service.url.rpartition(":")[2]
        with browser.page(f"http://{browsers.HOST}:{port}") as page:
            page.open("#/keys")
            page.wait(".bar .tag", "open to everyone")
            page.wait("[role=note]", "Everybody who reaches this address may build, activate and delete maps")
            page.wait(".empty", "No key yet")
            assert not violations(page)
            page.open("#/recorded-queries")
            page.wait(".empty", "Recording is off")
            assert not page.problems


# What hides from people who do not see or hear, or have no mouse


def test_what_is_not_accessible_is_found(page):
    """So that a page without findings says something."""
    page.open()
    page.wait("a", "yard")
    assert violations(page) == []
    page.js("document.querySelector('main').append(document.createElement('button'))")
    assert any(one.startswith("button-name: <button>") for one in violations(page))
    page.js("document.querySelector('main > button:last-child').remove()")
    page.prefers("dark")
    assert violations(page, of_colours=True) == []
    page.js(
        "{ const faint = document.createElement('p'); faint.textContent = 'faint';"
        " faint.style.color = 'light-dark(#000, #333)'; document.querySelector('main').prepend(faint); }"
    )
    assert any(one.startswith("color-contrast: <p ") for one in violations(page, of_colours=True))
    page.prefers("light")
    assert violations(page) == []
    page.js("document.querySelector('main > p:first-child').remove()")


# A phone


@pytest.mark.parametrize("view", ["", "recorded-queries?map=yard", "keys", "maps/yard/versions"])
def test_a_phone_reaches_every_button_without_scrolling_sideways(page, world, view):
    page.size(*PHONE, phone=True)
    world.ask(localized_scan(world)[0])
    wait_until(lambda: world.get("/recorded-queries", map_id="yard")["queries"])
    world.service.http.post(
        "/keys", json={"name": "phone", "scopes": ["localize"], "maps": ["*"]}, headers=world.headers("admin")
    )
    page.open(f"#/{view}")
    page.wait("tbody tr")
    outside = page.js(
        "[...document.querySelectorAll('.page :is(button, a, select, input)')].filter((e) => {"
        " const b = e.getBoundingClientRect(); return b.width && (b.right > 390 || b.left < 0); })"
        ".map((e) => e.outerHTML.slice(0, 80))"
    )
    assert outside == []
    page.until("document.querySelector('.page').scrollWidth <= 390")


def test_a_phone_shows_the_answer_without_scrolling(page, world):
    page.size(*PHONE, phone=True)
    page.open("#/maps/yard/try")
    page.map_picture()
    page.drop(".panel .drop", localized_scan(world)[0])
    page.wait(".verdict", "localized")
    top, bottom, shown = page.js(
        "{ const b = document.querySelector('.answer p').getBoundingClientRect();"
        " const p = document.querySelector('.panel').getBoundingClientRect(); [b.top, b.bottom, p.bottom]; }"
    )
    assert 0 < top < bottom <= min(shown, PHONE[1])


# A map's place on the Earth


def test_a_map_gets_its_place_on_the_earth_and_loses_it(page, world, coarse_version):
    world.service.catalog.publish("geo-hall", coarse_version.directory, coarse_version.manifest)
    page.expected += ["404"]  # of a place that was never set
    page.open("#/maps/geo-hall/earth")
    page.wait("[role=status]", "It is not known where this map lies")
    page.fill("Latitude", "48.2649")
    page.fill("Longitude", "11.6713")
    page.fill("Height above the ellipsoid", "529.4")
    page.fill("The map's x axis", "400")
    page.click("button", "Set the place")
    assert not page.has("dialog"), "the browser names the field that is out of range"
    page.fill("The map's x axis", "30")
    page.click("button", "Set the place")
    page.wait("dialog", "Set where geo-hall lies")
    page.click("dialog button", "Leave it")
    page.click("button", "Set the place")
    page.click("dialog button", "Set it")
    page.wait("[role=status]", "lies at 48.2649°, 11.6713°, 529.4 m")
    page.wait("[role=status]", "points to 60.0° on a compass")
    said = world.get("/maps/geo-hall/georeference")
    assert (said["latitude_deg"], said["longitude_deg"], said["height_m"]) == (48.2649, 11.6713, 529.4)
    assert abs(said["x_axis_deg"] - 30) < 1e-9
    assert violations(page) == []
    page.click("button", "Remove the place")
    page.click("dialog button", "Remove")
    page.wait("[role=status]", "It is not known where this map lies")
