"""The console in a real browser: the page of a map. Is it good, what is on it, and can it be read?"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from datetime import datetime, timedelta, timezone

import pytest

from firstfix_client import Client
from plugins.console.tests.page import CANVAS, Picture
from plugins.console.tests.pictures import ADDED, GONE, difference, drawn_pixels, pixels_of
from tests.changed_yard import CONFIG, ChangedYard
from tests.waiting import wait_until

pytestmark = pytest.mark.slow


def test_a_map_says_first_whether_it_is_good_and_what_was_found(page, world, small_version, coarse_version):
    page.open("#/maps/yard")
    page.wait("[aria-label='Is it good?'] .grade", "good")
    report = world.get(f"/maps/yard/versions/{world.versions[1]}/report")
    cells = report["self_test"]["localizability"]
    found = sum(2 * one["localized"] >= one["scans"] for one in cells)
    page.wait("[aria-label='Is it good?'] dd", f"{found} of {len(cells)}")
    page.wait("[aria-label='Is it good?']", "The checks of the map found nothing wrong")

    finding = {
        "code": "map_rounded",
        "severity": "warning",
        "text": "Coordinates of 400,000 m in float32 are precise to 0.03 m.",
        "numbers": {},
        "remedy": "Export it in float64.",
        "doc": "docs/how-to/my-map.md",
    }
    manifest = small_version.manifest
    told = type(manifest)(**{**vars(manifest), "source": {**manifest.source, "findings": [finding]}})
    world.service.catalog.publish("rounded", small_version.directory, told)
    page.open("#/maps/rounded")
    page.wait(".findings .warning", finding["text"])
    page.wait(".findings .warning", finding["remedy"])
    page.map_picture()  # all of it is there before the map goes
    assert world.service.http.delete("/maps/rounded", headers=world.headers("admin")).is_success


def test_what_real_scans_showed_is_beside_the_simulated_ones(page, world, small_version):
    page.open("#/maps/yard")
    page.wait("[aria-label='Is it good?'] .grade")
    assert "eal scans" not in page.text("[aria-label='Is it good?']"), "its source has none"

    manifest = small_version.manifest
    real = {
        "asked": 15,
        "localized": 0.6,
        "false_accepts": 2,
        "disagree": ["localized"],
        "left_out": {"lobby.pcd": "its pose does not fit the map"},
        "held_out": {"keyframes": 12, "parts": 5, "kept_out": {"no other keyframe is within 5 m": 3}},
    }
    told = {**manifest.self_test, "real": real}
    world.service.catalog.publish(
        "of_scans", small_version.directory, type(manifest)(**{**vars(manifest), "self_test": told})
    )
    page.open("#/maps/of_scans")
    page.wait("[aria-label='Is it good?'] [role=alert]", "disagree (localized): believe the real ones")
    facts = page.text("[aria-label='Is it good?']")
    for words in ("60 % of 15 scans", "12 keyframes in 5 parts"):
        assert words in facts, words
    page.click("[aria-label='Is it good?'] summary", "Real scans that were not asked")
    page.wait("[aria-label='Is it good?'] details li", "lobby.pcd: its pose does not fit the map")
    kept = "3 keyframes kept in the map: no other keyframe is within 5 m"
    page.wait("[aria-label='Is it good?'] details", kept)
    page.map_picture()  # all of it is there before the map goes
    assert world.service.http.delete("/maps/of_scans", headers=world.headers("admin")).is_success


def test_places_mapped_in_part_are_crossed_in_the_heat(page, world, small_version):
    page.size(1200, 600)  # the bar has one line, whatever the map is called
    page.open("#/maps/yard?layers=localizability")
    page.wait("[aria-label='Colours of the places']", "half")
    before = page.map_picture()
    assert "Crossed" not in page.js("document.querySelector('.legend-of-heat').textContent")

    manifest = small_version.manifest
    cells = [{**one, "never_seen": 0.61, "in_part": True} for one in manifest.self_test["localizability"]]
    told = {**manifest.self_test, "localizability": cells}
    world.service.catalog.publish(
        "in_part", small_version.directory, type(manifest)(**{**vars(manifest), "self_test": told})
    )
    page.open("#/maps/in_part?layers=localizability")
    page.wait("[aria-label='Colours of the places']", "Crossed: mapped in part")
    wait_until(lambda: difference(before, page.map_picture()) > 0.0005)
    assert world.service.http.delete("/maps/in_part", headers=world.headers("admin")).is_success


def test_places_that_are_known_and_not_said_are_told_with_what_helps(page, world, small_version):
    page.open("#/maps/yard")
    page.wait("[aria-label='Is it good?'] dt", "Right place first, or among those that tie")

    manifest = small_version.manifest
    first, second, *others = [
        {name: value for name, value in one.items() if name != "helps"}
        for one in manifest.self_test["localizability"]
    ]
    silent = [{**first, "helps": "second_scan"}, {**second, "helps": "drive_through"}]
    told = {**manifest.self_test, "localizability": [*silent, *others], "localized": 0.2, "found": 0.9}
    world.service.catalog.publish(
        "silent", small_version.directory, type(manifest)(**{**vars(manifest), "self_test": told})
    )
    page.open("#/maps/silent")
    page.wait("[aria-label='Is it good?'] .grade", "fair")
    page.click("[aria-label='Is it good?'] summary", f"2 of {len(others) + 2} places are known and not said")
    page.wait(
        "[aria-label='Is it good?'] details li", "a second scan from 1 to 2 m further on, or a prior: 1"
    )
    page.wait(
        "[aria-label='Is it good?'] details", "driving through it while mapping, as it was mapped in part: 1"
    )
    page.map_picture()  # all of it is there before the map goes
    assert world.service.http.delete("/maps/silent", headers=world.headers("admin")).is_success


def test_versions_and_recorded_queries_of_a_map_are_on_its_page(page, world):
    world.ask(world.scans[0][0])
    older = world.versions[0][:12]
    page.open("#/maps/yard")
    page.map_picture()
    page.wait("[aria-label='Recorded queries of the map'] li")
    page.press("t")
    page.until("location.hash.includes('view=')")
    view = page.js("new URLSearchParams(location.hash.split('?')[1]).get('view')")
    page.click("[aria-label='Versions of the map'] button", older)
    page.wait("[aria-label='Is it good?'] .tag", "not active")
    page.until(f"location.hash.includes('version={world.versions[0]}')")
    page.map_picture()
    assert page.js("new URLSearchParams(location.hash.split('?')[1]).get('view')") == view, "as from before"
    before = page.map_picture()
    page.click("label.check", "Recorded queries, by verdict")
    wait_until(lambda: difference(before, page.map_picture()) > 0.0001)
    page.click("[aria-label='Recorded queries of the map'] a", "Look")
    page.until("location.hash.includes('/try?recorded=')")


def test_the_keys_of_the_picture_are_listed_and_work_from_the_page(page):
    page.open("#/maps/yard?layers=")
    before = page.map_picture()
    page.wait(".keys button", "Keyboard: ?")
    page.press("?")
    page.wait("dialog kbd", "Shift and arrow keys")
    page.press("Escape")
    page.until("!document.querySelector('dialog')")
    page.press("t")
    wait_until(lambda: difference(before, page.map_picture()) > 0.2)
    above = page.map_picture()
    page.press("ArrowUp")
    wait_until(lambda: difference(above, page.map_picture()) > 0.01)
    page.click("button", "Whole map")
    wait_until(lambda: difference(before, page.map_picture()) < 0.01)


def test_an_address_given_to_an_open_page_moves_it(page, house):
    page.open(f"#/maps/{house}?layers=")
    whole = page.map_picture()
    page.js(f"location.hash = '#/maps/{house}?layers=templates&colour=normal&storey=1&view=0,0,1,0,0,30'")
    page.until("find('select', 'Colour').value === 'normal' && find('select', 'Storeys shown').value === '1'")
    assert page.js("find('label.check input', 'Templates').checked")
    wait_until(lambda: drawn_pixels(page.map_picture()) < 0.5 * drawn_pixels(whole))


def test_the_scale_is_that_of_the_picture(page):
    """The yard is 16 m wide: from above, its bar tells how many pixels that is."""
    page.open("#/maps/yard?layers=&view=0,0,0,0,0,30")
    picture = page.map_picture()
    name = str(page.js("document.querySelector('.bar-of-scale').getAttribute('aria-label')"))
    length_m = float(name.split()[3])
    bar_px = float(page.js("document.querySelector('.bar-of-scale').getBoundingClientRect().width")) - 2
    row = picture[picture.shape[0] // 2].astype(int)
    drawn = (abs(row - (16, 22, 27)).max(axis=1) > 12).nonzero()[0]
    assert (drawn[-1] - drawn[0]) * length_m / bar_px == pytest.approx(16.0, rel=0.12)
    assert page.js(f"document.querySelector('{CANVAS} .axes').getAttribute('aria-label')").startswith("Axes")


# A patch


@pytest.fixture(scope="module")
def mended(world, small_world, cloud_version, tmp_path_factory) -> Iterator[tuple[str, str]]:
    """The map "mended" and a patch of it that waits: the versions before and after, built by the service."""
    config = {**CONFIG, "self_test": {**CONFIG["self_test"], "queries": 20, "outside": 2}}
    start = datetime.now(timezone.utc) - timedelta(days=5)
    folder = tmp_path_factory.mktemp("mended")
    yard = ChangedYard(small_world, folder, world.service.settings.store, "mended", start)
    built = cloud_version.directory.parent / "stages"
    shutil.copytree(built, world.service.settings.work_dir / "stages", dirs_exist_ok=True)
    with Client(world.service.url, api_key=world.keys["admin"]) as client:
        client.wait_for_build(client.build_map(folder / "cloud.npy", "mended", config=config).build_id)
        base = world.get("/maps/mended")["active_version"]
        yard.ask(yard.localizer(base), base, ["key:ann", "key:bob"], range(4), 4)
        told = world.service.http.post(
            "/maps/mended/patch", params={"mode": "propose"}, headers=world.headers("admin")
        )
        assert told.status_code == 202, told.text
        client.wait_for_build(told.json()["build_id"])
    build = world.get(f"/builds/{told.json()['build_id']}")
    assert (build["state"], build["activated"]) == ("succeeded", False), build
    yield base, build["version"]
    # the start page of other tests has no build that waits
    assert world.service.http.delete("/maps/mended", headers=world.headers("admin")).is_success
    for key in world.service.catalog.store.list(f"builds/{build['build_id']}/"):
        world.service.catalog.store.delete(key)


def _sides(page) -> tuple[Picture, Picture]:
    """The pictures of the map before and after the patch, once all their points are there."""
    page.until(
        "document.querySelectorAll('.sides .map-canvas[aria-busy=false]').length === 2", "both pictures"
    )
    page.js("new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(() => drawn())))")
    before, after = (page.picture(f".sides figure:nth-of-type({number}) canvas") for number in (1, 2))
    legends = 100  # pixels: axes and scale have colours of their own
    return before[:-legends], after[:-legends]


def _marks(page) -> tuple[int, int, int, int]:
    """Pixels of removed points before and after the patch, and of added points before and after it."""
    before, after = _sides(page)
    return tuple(pixels_of(side, colour, 30) for colour in (GONE, ADDED) for side in (before, after))


def test_a_patch_shows_each_area_before_and_after(page, world, mended):
    _, patched = mended
    record = world.get(f"/maps/mended/versions/{patched}")["manifest"]["source"]["patch"]
    assert {one["kind"] for one in record["areas"]} == {"gone", "new"}
    page.open("#/maps/mended")
    page.click("[aria-label='Versions of the map'] a", "Before and after")
    points = {"gone": 0, "new": 0}
    for number, area in enumerate(record["areas"], 1):
        row = f"[aria-label='Changed areas'] li:nth-child({number})"
        page.wait(row, f"{area['robots']} robots saw it, on {area['days']} days")
        page.click(f"{row} button", area["kind"])
        page.wait(f"{row} [aria-pressed=true]")
        page.until(f"location.hash.includes('area={number}')")
        is_new = area["kind"] == "new"
        own = 3 if is_new else 0
        legend = f"[aria-label='Colours of the points'] li.{area['kind']}"
        page.wait(legend, "added: " if is_new else "removed: ")
        points[area["kind"]] += int(page.text(legend).split()[1].replace(",", ""))
        wait_until(lambda own=own: _marks(page)[own] > 30, what=f"the points of area {number}")
        assert _marks(page)[1:3] == (0, 0), "a point is marked where it is, and not where it is missing"
    assert points == {"gone": record["removed_points"], "new": record["added_points"]}

    compared = record["compared"]
    page.wait("[aria-label='Where nothing has changed']", f"the same {compared['places']} scans")
    row = f"Localized{compared['localized_before']}{compared['localized_after']}"
    page.wait("[aria-label='Where nothing has changed'] tr", row)
    page.wait("[aria-label='Who saw it'] div", f"Robots that asked them{record['robots']}")
    page.until("location.hash.includes('view=')")
    sides, link = _sides(page), page.js("location.hash")
    page.open(link)
    page.wait("[aria-label='Changed areas'] li:nth-child(2) [aria-pressed=true]")
    wait_until(lambda: max(map(difference, sides, _sides(page))) < 0.02, what="the view of the link")


def test_a_patch_that_waits_is_activated_and_rolled_back(page, world, mended):
    base, patched = mended
    page.open("#/live?map=mended")
    page.wait(".alerts li", "A patch of ")
    page.open()
    page.wait(".builds [role=alert]", "The patched version is published, and not activated")
    page.click(".builds a", "Before and after")
    page.wait("aside .tag", "waits for somebody")
    page.click("aside button", "Activate")
    page.wait("dialog", f"{patched[:12]} answers all robots that ask mended")
    page.click("dialog button", "Activate")
    page.wait("aside .tag", "active")
    assert world.get("/maps/mended")["active_version"] == patched
    page.click("aside button", "Roll back")
    page.wait("dialog", f"The version that was active before {patched[:12]}")
    page.click("dialog button", "Roll back")
    page.wait("aside .tag", "waits for somebody")
    assert world.get("/maps/mended")["active_version"] == base
