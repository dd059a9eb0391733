"""The console in a real browser, with a real service and real maps: maps, a map in 3D, and versions."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import datetime, timezone
from itertools import combinations

import numpy as np
import pytest

from firstfix.builds.options import reported_stages
from firstfix.catalog.sightings.sightings import Sightings
from firstfix.engine.changes.cells import keys_of
from firstfix.engine.changes.sighting import Sighting
from firstfix.engine.changes.tally import UNMAPPED, Tally
from firstfix.engine.index import MapIndex
from firstfix.wire.scan import encode_scan
from firstfix_client import Client
from plugins.console.tests.console_world import MARKUP, scans_without_cabin
from plugins.console.tests.page import CANVAS, Picture
from plugins.console.tests.pictures import (
    ADDED,
    GONE,
    UNEXPLAINED,
    difference,
    drawn_pixels,
    pixels_of,
    place_in,
    reddened,
    view_of,
)
from tests.small_world import SENSOR
from tests.waiting import let_pass, wait_until

pytestmark = pytest.mark.slow
# Sensors with which no other test builds the house: stages that it had made would be taken over, and the
# build would end before a test has looked at it.
OF_NO_OTHER_TEST = ("os1-64", "os1-128", "os0-128")


# Maps


def test_a_map_is_built_from_a_dropped_file(page, world, house_file, tmp_path):
    page.open()
    page.click("button", "Build a map")
    page.choose("Sensor of the robots", "vlp-16")
    page.wait("svg[role=img]", "beams")
    broken = tmp_path / f"{MARKUP}.ply"
    broken.write_bytes(b"ply\nformat ascii 1.0\nelement vertex 1000000\n")
    page.drop(".drop", broken)
    page.wait(".drop", broken.name)  # the file is read after the drop
    assert page.js("find('input', 'Name of the map').validity.valid")
    page.fill("Name of the map", "broken")
    page.click("dialog button.primary", "Build")
    page.wait(".builds [role=alert]", "ply")
    assert page.count("img:not(.thumbnail img)") == 0
    assert "Failed at: " in page.text(".builds .failed")
    assert "Handed in just now" in page.text(".builds .failed")
    page.click(".builds button", "Try again")
    page.wait("dialog")
    assert page.js("find('input', 'Name of the map').value") == "broken"
    page.press("Escape")
    page.click("button", "Hide")
    page.until("!find('.builds li', 'broken')")
    page.open()
    page.wait("a", "yard")
    page.until("performance.getEntriesByType('resource').some((one) => one.name.includes('/builds'))")
    assert not page.has(".builds li", "broken")

    _hand_in(page, house_file, OF_NO_OTHER_TEST[0])
    stages = json.dumps([stage.replace("_", " ") for stage in reported_stages()])
    shown = "document.querySelector('.builds .progress')?.innerText.split('\\n')[0]"
    page.until(f"{stages}.includes({shown})", "a stage of the build")
    page.click(".builds button", "Cancel")
    page.wait("dialog", "Cancel the build of cottage")
    assert world.get("/builds", limit=1)["builds"][0]["state"] in ("queued", "running")
    page.click("dialog button", "Cancel the build")
    page.until("!document.querySelector('.builds')")
    wait_until(lambda: world.get("/builds", limit=1)["builds"][0]["state"] == "cancelled")

    nearsighted = tmp_path / "nearsighted.json"
    nearsighted.write_text(json.dumps({**SENSOR, "azimuth_step_deg": 2.4, "max_range_m": 1.2}))
    _hand_in(page, house_file, nearsighted)
    wait_until(lambda: world.get("/builds", limit=1)["builds"][0]["state"] == "succeeded")
    (build,) = world.get("/builds", limit=1)["builds"]
    assert not build["activated"], "a sensor that sees so little localizes nothing"
    page.wait(".builds [role=alert]", "it is published, and not activated")
    world.service.catalog.activate("cottage", build["version"])
    page.wait("tr", build["version"][:12])
    page.until("!find('.builds li', 'cottage')", "nothing left to activate")
    page.until("!find('tr .tag', 'provisional')")


def _hand_in(page, file, sensor) -> None:
    """Builds the map "cottage". ``sensor``: a preset's name, or a file."""
    page.click("button", "Build a map")
    if isinstance(sensor, str):
        page.choose("Sensor of the robots", sensor)
        page.wait("svg[role=img]", "beams")  # until then the dialog grows
    else:
        page.choose("Sensor of the robots", "another one: a YAML or JSON file")
        page.give_file("dialog input[accept*=yaml]", sensor)
    page.drop("dialog .drop", file)
    page.wait("dialog .drop", file.name)
    page.fill("Name of the map", "cottage")
    if page.has("dialog label.check", "Replace the active version"):  # the provisional one
        page.click("dialog label.check", "Replace the active version")
    page.click("dialog button.primary", "Build")
    page.wait(".builds li", "cottage")


def test_a_map_is_deleted_after_its_name_was_typed(page, world, coarse_version):
    world.service.catalog.publish("old-hall", coarse_version.directory, coarse_version.manifest)
    page.open()
    page.click("button", "Delete map old-hall")
    page.fill("Type the map's name", "old-hal")
    assert page.js("find('dialog button', 'Delete').disabled")
    page.press("Escape")
    page.until("!document.querySelector('dialog')")
    page.click("button", "Delete map old-hall")
    page.fill("Type the map's name", "old-hall")
    page.press("Enter")
    page.until("!find('tr', 'old-hall')")
    assert [one["map_id"] for one in world.get("/maps")["maps"] if one["map_id"] == "old-hall"] == []


def test_a_build_stands_on_the_page_of_its_map(page, world, house_file):
    page.expected += ["404"]  # there is no version yet
    with Client(world.service.url, api_key=world.keys["admin"]) as client:
        build_id = client.build_map(house_file, "annex", config={"sensor": OF_NO_OTHER_TEST[1]}).build_id
    page.open("#/maps/annex")
    page.wait(".empty", "its first build has not ended")
    page.wait(".empty .builds progress")
    page.click(".empty .builds button", "Cancel")
    page.click("dialog button", "Let it go on")
    page.until("!document.querySelector('dialog')")
    assert page.js("document.activeElement === find('.builds button', 'Cancel')")
    page.click(".empty .builds button", "Cancel")
    page.click("dialog button", "Cancel the build")
    wait_until(lambda: world.get(f"/builds/{build_id}")["state"] == "cancelled")
    page.until("!document.querySelector('.builds')")


def test_builds_say_why_they_wait_and_how_long_each_stage_took(page, world, house_file):
    page.open()
    page.wait("a", "yard")
    with Client(world.service.url, api_key=world.keys["admin"]) as client:
        config = {"sensor": OF_NO_OTHER_TEST[2]}
        builds = [client.build_map(house_file, name, config=config).build_id for name in ("shed", "barn")]
        page.wait(".builds li", "behind")
        assert "shed" in page.js("find('.builds li', 'behind').querySelector('.of-build p').innerText")
        page.until("[...document.querySelectorAll('.stages small')].some((e) => e.innerText.endsWith(' s'))")
        page.wait(".stages li", "fetch source")
        for build_id in reversed(builds):
            client.cancel_build(build_id)
            wait_until(lambda build_id=build_id: client.build_status(build_id).is_final)
    page.until("!find('.builds li', 'shed') && !find('.builds li', 'barn')")


def test_a_failed_build_says_on_a_phone_why_and_what_helps(page, world, coarse_version, tmp_path):
    world.service.catalog.publish("works", coarse_version.directory, coarse_version.manifest)
    broken = tmp_path / "broken.ply"
    broken.write_bytes(b"ply\nformat ascii 1.0\nelement vertex 1000000\n")
    with Client(world.service.url, api_key=world.keys["admin"]) as client:
        build_id = client.build_map(broken, "works", config={"sensor": "vlp-16"}).build_id
    wait_until(lambda: world.get(f"/builds/{build_id}")["state"] == "failed")
    reason = world.get(f"/builds/{build_id}")["error"]["detail"]
    page.size(390, 844, phone=True)
    page.expected += ["404"]  # the log is kept as the process ends, after it has said that it failed
    for view in ("", "maps/works"):
        page.open(f"#/{view}")
        page.wait(".builds [role=alert]", reason)
        page.wait(".builds .failed small", "firstfix check FILE reads the file without a build")
        page.wait(".builds .failed small", "Failed at: ")
        page.click(".builds .failed summary", "Log")
        page.wait(".builds .failed pre", "PLY")
        left, right = page.js(
            "{ const all = [...document.querySelectorAll('.builds *')].map((e) => e.getBoundingClientRect());"
            " [Math.min(...all.map((b) => b.left)), Math.max(...all.map((b) => b.right))]; }"
        )
        assert left >= 0
        assert right <= 390
    page.click(".builds button", "Try again")
    page.wait("dialog [role=alert]", "There is a map works")
    page.press("Escape")
    page.until("!document.querySelector('dialog')")


# A map in 3D


def test_a_map_is_seen_in_colours_and_storeys(page, house):
    side = view_of((0, 0, 3), (0, -11, 3.2))
    page.open(f"#/maps/{house}?view={side}")
    whole = page.map_picture()
    assert drawn_pixels(whole) > 0.05 * whole.shape[0] * whole.shape[1]
    pictures = [whole]
    for colour in ("Storey", "Normal", "One colour"):
        page.choose("Colour", colour)
        pictures.append(page.map_picture())
    for one, other in combinations(range(4), 2):
        assert difference(pictures[one], pictures[other]) > 0.05

    page.choose("Storeys shown", "Storey 1")
    lower = page.map_picture()
    middle = whole.shape[0] // 2
    assert drawn_pixels(lower[: middle - 60]) < 0.02 * drawn_pixels(whole[: middle - 60])
    assert drawn_pixels(lower[middle:]) > 0.5 * drawn_pixels(whole[middle:])


def test_layers_are_laid_over_a_map(page, house):
    page.open(f"#/maps/{house}")
    page.choose("Storeys shown", "Storey 1")
    for layer in ("Templates", "Where a robot finds itself"):
        before = page.map_picture()
        page.click("label.check", layer)
        wait_until(lambda before=before: difference(before, page.map_picture()) > 0.0001, what=layer)
    page.click("label.check", "Changes since the map was made")
    page.map_picture()
    assert not page.has("[role=alert]")


def test_what_has_changed_is_laid_over_a_map(page, world, small_version, small_world, tmp_path):
    """Robots ask in the yard after its cabin has gone."""
    world.service.catalog.publish("yard-later", small_version.directory, small_version.manifest)
    page.open("#/maps/yard-later?layers=changes")
    page.wait("[role=status]", "No query was counted yet")

    templates_m = MapIndex.load(small_version.directory).cascade.templates.position_m
    before = world.looked_at_sightings()
    for number, scan in enumerate(scans_without_cabin(small_world, templates_m), 1):
        file = tmp_path / f"{number}.ffscan"
        file.write_bytes(encode_scan(scan))
        assert world.ask(file, map="yard-later")["probability"] > 0.99
        wait_until(lambda number=number: world.looked_at_sightings() >= before + number)
    target, eye = (5.0, 3.5, 1.2), (5.0, -4.0, 9.0)
    page.open(f"#/maps/yard-later?colour=plain&view={view_of(target, eye)}")
    unmarked = page.map_picture()
    page.wait("[aria-label=Changes] li", "gone: 1")
    page.wait("[aria-label=Changes] li", "new: 0")
    page.wait("[aria-label=Changes] li", "never mapped: not known")
    assert pixels_of(unmarked, GONE, 30) == 0, "they are listed before they are drawn"
    page.click("label.check", "Changes since the map was made")
    wait_until(lambda: pixels_of(page.map_picture(), GONE, 30) > 0)
    gone = reddened(unmarked, page.map_picture())
    height, width = gone.shape
    x, y = (int(v) for v in place_in(target, target, eye, width, height))
    around = np.zeros_like(gone)
    around[y - 150 : y + 150, x - 180 : x + 180] = True  # the cabin is 3 m long, and its cells a little more
    assert gone[y - 60 : y + 60, x - 60 : x + 60].mean() > 0.8
    assert gone[~around].mean() < 0.001
    (area,) = world.get("/maps/yard-later/changes")["areas"]
    page.open("#/maps/yard-later?colour=plain&layers=")
    whole = page.map_picture()
    row = "[aria-label='Changed areas'] li"
    page.wait(row, f"gone, {area['box']['high'][0] - area['box']['low'][0]:.1f} ")
    page.wait(row, f"{area['sightings']} queries from {area['spots']} spots saw it: first ")
    page.click(f"{row} button", "5.")
    page.until("location.hash.includes('layers=changes') && location.hash.includes('view=')")
    wait_until(lambda: pixels_of(page.map_picture(), GONE, 30) > 0)
    assert difference(whole, page.map_picture()) > 0.05, "the camera has gone there"
    view = [
        float(m) for m in page.js("new URLSearchParams(location.hash.split('?')[1]).get('view')").split(",")
    ]
    assert view[:2] == pytest.approx(target[:2], abs=0.5)


def _seen_at(low: tuple[int, int, int], *, unmapped: bool) -> Tally:
    """Counts of robots at eight spots that see 3 x 3 x 3 cells which the map does not explain."""
    keys = np.sort(keys_of(np.array(list(np.ndindex(3, 3, 3))) + low))
    none = np.empty(0, np.int64)
    never_seen = keys if unmapped else none
    return Tally.sum(
        Tally.of(Sighting((7 * spot, 0, 1), none, none, keys, none, never_seen, True)) for spot in range(8)
    )


@pytest.mark.parametrize("is_known", [True, False])
def test_what_was_never_mapped_is_told_from_what_is_new(page, world, small_version, is_known):
    """Counts that a replica has stored, of a version that knows what its mapping run saw, or does not."""
    map_id, catalog = f"yard-hole-{is_known}".lower(), world.service.catalog
    version = catalog.publish(map_id, small_version.directory, small_version.manifest)
    seen = Tally.sum([_seen_at((8, 6, 1), unmapped=False), _seen_at((-6, 2, 1), unmapped=True)])
    if not is_known:
        counts = seen.counts.copy()
        counts[:, UNMAPPED] = 0
        seen = replace(seen, counts=counts, coverage_known=0)
    Sightings(catalog.store).put(catalog.folder_of(map_id, version), seen, datetime.now(timezone.utc))
    page.open(f"#/maps/{map_id}?colour=plain&layers=")
    kinds = "[aria-label='Kinds of changes'] li"
    page.wait(kinds, "new: 1" if is_known else "new: 2")
    page.wait(f"{kinds}.unmapped", "never mapped: 1" if is_known else "never mapped: not known")
    rows = page.js(
        "Array.from(document.querySelectorAll('[aria-label=\"Changed areas\"] li'), (one) => one.className)"
    )
    assert rows == (["new", "unmapped"] if is_known else ["new", "new"])
    told = "Parts that were never mapped are among the new ones"
    assert (told in page.text("[aria-label=Changes]")) != is_known
    before = page.map_picture()
    few = 20  # pixels: an axis is green, too
    assert max(pixels_of(before, UNEXPLAINED, 30), pixels_of(before, ADDED, 30)) < few
    page.click("label.check", "Changes since the map was made")
    wait_until(lambda: pixels_of(page.map_picture(), ADDED, 30) > few)
    assert (pixels_of(page.map_picture(), UNEXPLAINED, 30) > few) == is_known
    assert not page.has("[role=alert]")


def _at_rest(page) -> tuple[Picture, str]:
    """The picture and the address, once the camera rests: slow frames come after the address."""
    seen: list[tuple[Picture, str]] = []

    def rests() -> bool:
        link, before = page.js("location.hash"), page.map_picture()
        let_pass(0.6)
        seen.append((page.map_picture(), page.js("location.hash")))
        return seen[-1][1] == link and difference(before, seen[-1][0]) == 0

    wait_until(rests, what="the camera rests")
    return seen[-1]


def test_a_link_opens_the_same_view(page, house):
    page.open(f"#/maps/{house}")
    first = page.map_picture()
    page.choose("Colour", "Normal")
    page.drag((400, 400), (520, 330))
    page.until("location.hash.includes('view=')")
    moved, link = _at_rest(page)
    assert difference(first, moved) > 0.05
    page.open(link)
    wait_until(lambda: difference(moved, page.map_picture()) < 0.02)  # the link says millimetres
    page.click("button", "Whole map")
    page.choose("Colour", "Height above the floor")
    wait_until(lambda: difference(first, page.map_picture()) < 0.01, what="the whole map")


def test_a_distance_is_measured_between_two_clicks(page, world):
    eye, target = (5.0, 3.3, 8.5), (5.0, 3.5, 2.4)
    page.open(f"#/maps/yard?view={view_of(target, eye)}")
    page.map_picture()
    page.click("label.check", "Click two points")
    x, y, width, height = page.box(f"{CANVAS} canvas")
    along = np.array([np.cos(0.3), np.sin(0.3), 0.0])  # of the cabin, 3 m long
    for end in (-1.5, 1.5):
        px, py = place_in(np.array([5.0, 3.5, 2.4]) + end * along, target, eye, width, height)
        page.click_at(x + px, y + py)
    page.wait("output", " m")
    assert float(page.text("output").split()[0]) == pytest.approx(3.0, abs=0.15)


def test_a_map_that_is_left_is_not_watched_any_more(page):
    page.call(
        "Page.addScriptToEvaluateOnNewDocument",
        source="globalThis.watched = new Map(); globalThis.ResizeObserver = class extends ResizeObserver {"
        " observe(one, ...rest) { watched.set(this, one); super.observe(one, ...rest); }"
        " disconnect() { watched.delete(this); super.disconnect(); } }",
    )
    page.open("#/maps/yard")
    page.map_picture()
    assert page.js("[...watched.values()].some((one) => one.matches('.map-canvas'))")
    page.click("a", "Maps")
    page.wait("button", "Build a map")
    page.until("watched.size === 0")


# Versions


def test_versions_are_compared_activated_rolled_back_and_retired(page, world, coarse_version, small_version):
    publish = world.service.catalog.publish
    versions = [publish("compared", one.directory, one.manifest) for one in (coarse_version, small_version)]
    old, new = (version[:12] for version in versions)
    page.open("#/maps/compared/versions")
    page.wait("tr .tag", "active")
    page.click("input[type=checkbox]", f"Compare {old}")
    page.click("input[type=checkbox]", f"Compare {new}")
    page.wait("[aria-label=Comparison] td", "643")
    page.wait("[role=status]", "places that both self-tests have")
    assert page.js("[...document.querySelectorAll('td strong')].map((e) => e.innerText)") == [
        f"{100 * world.get(f'/maps/compared/versions/{one}')['manifest']['self_test']['localized']:.0f} %"
        for one in reversed(versions)
    ]
    page.click(f"tr:has([aria-label='Compare {old}']) button", "Activate")
    page.wait(
        "dialog", f"{old} answers all robots that ask compared, from their next query on, in place of {new}"
    )
    page.press("Escape")
    page.until("!document.querySelector('dialog')")
    assert world.get("/maps/compared")["active_version"] == versions[1]
    page.click(f"tr:has([aria-label='Compare {old}']) button", "Activate")
    page.click("dialog button", "Activate")
    page.wait(f"tr:has([aria-label='Compare {old}']) .tag", "active")
    assert world.get("/maps/compared")["active_version"] == versions[0]
    page.click("header button", "Roll back")
    page.wait("dialog", f"The version that was active before {old}")
    assert world.get("/maps/compared")["active_version"] == versions[0]
    page.click("dialog button", "Roll back")
    page.wait(f"tr:has([aria-label='Compare {new}']) .tag", "active")
    assert world.get("/maps/compared")["active_version"] == versions[1]
    page.click(f"tr:has([aria-label='Compare {old}']) button", "Retire")
    page.wait("dialog", "removes its files for good")
    assert page.js("find('dialog button', 'Retire').disabled")
    page.fill("Type the version", old)
    page.click("dialog button", "Retire")
    page.until(f"!find('tr', '{old}')")
    assert [one["version"] for one in world.get("/maps/compared/versions")["versions"]] == [versions[1]]
    page.until("!find('th', 'Compare') && !find('.hint', 'Choose two versions')")
