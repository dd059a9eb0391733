"""The list of maps, a map's picture, its versions, builds and files, in a real browser."""

from __future__ import annotations

import numpy as np
from PIL import ImageColor

from firstfix.catalog.manifest import Manifest
from firstfix.catalog.provenance import Provenance
from firstfix.engine.index import MAP_FILE
from firstfix_builder.index.cloud_octree import CloudOctree
from firstfix_builder.mesh.intensity import Intensity
from firstfix_client import Client
from plugins.console.tests.export.test_export_command import messages, points_in
from plugins.console.tests.pictures import difference, drawn_pixels, place_in, view_of
from plugins.console.tests.routes.test_http_scan_report import pcd
from tests.waiting import wait_until

GREY = ImageColor.getrgb("#8fa3ad")  # of points in one colour


def colourful(picture) -> float:
    """Share of the pixels that are far from grey."""
    spread = picture.astype(int).max(axis=2) - picture.astype(int).min(axis=2)
    return float((spread > 90).mean())


def test_maps_are_found_and_sorted_and_have_pictures_in_the_colours_of_the_page(page, world, house):
    page.open()
    page.wait("tr", "yard")
    page.until("[...document.querySelectorAll('.thumbnail img')].filter((e) => e.naturalWidth).length >= 2")
    for scheme in ("light", "dark"):
        page.prefers(scheme)
        # The outermost pixels are the table's, too, where the row does not begin at a whole pixel.
        picture = page.picture("tr:has([href='#/maps/yard']) .thumbnail")[4:-4, 4:-4].astype(int)
        assert (picture.min(axis=2) > 230).mean() < 0.01, f"{scheme}: nothing of it is white"
    rows = "[...document.querySelectorAll('table.maps th[scope=row]')].map((e) => e.innerText.trim())"
    names = (
        f"{rows}.filter((name) => ['house', 'yard'].includes(name)).join()"  # other tests have maps here, too
    )
    assert page.js(names) == "house,yard"
    page.click("th button", "Localized in its self-test")
    assert page.js(names) == "yard,house", "the best first"
    assert page.js("find('th', 'Localized in its self-test').getAttribute('aria-sort')") == "descending"
    page.click("th button", "Localized in its self-test")
    assert page.js(names) == "house,yard"
    published = world.get("/maps/yard")["published_time"]
    assert page.js(f"!!document.querySelector('tr time[datetime=\"{published}\"]')")
    page.fill("Find", "yar")
    page.until(f"{names} === 'yard'")
    page.fill("Find", "nothing")
    page.wait("[role=status]", "No map has nothing in its name")


def test_points_are_as_large_as_somebody_wants_and_the_link_says_so(page):
    near = view_of((0, 0, 0.5), (0, -4, 2.5))
    page.open(f"#/maps/yard?layers=&view={near}")
    usual = drawn_pixels(page.map_picture())
    slider = "find('input[type=range]', 'Point size')"
    page.js(f"{slider}.focus()")
    for _ in range(12):
        page.press("ArrowRight")
    page.until("location.hash.includes('size=14')")
    wait_until(lambda: drawn_pixels(page.map_picture()) > 1.05 * usual)
    page.open(f"#/maps/yard?layers=&size=2&view={near}")
    assert drawn_pixels(page.map_picture()) < 0.95 * usual
    assert page.js(f"{slider}.value") == "2"


def test_a_grid_lies_on_the_floor_and_the_mouse_has_coordinates(page):
    target, eye = (0.0, 0.0, 0.0), (0.0, -0.1, 14.0)
    page.open(f"#/maps/yard?layers=&colour=plain&view={view_of(target, eye)}")
    before = page.map_picture()
    page.click("label.check", "Grid on the floor")
    page.wait("label.check small", "a line each 1 m")
    wait_until(lambda: difference(before, page.map_picture()) > 0.001)

    left, top, width, height = page.box(".map-canvas canvas")
    place = (3.0, 2.0, 0.0)  # free floor
    x, y = place_in(place, target, eye, width, height)
    page.call("Input.dispatchMouseEvent", type="mouseMoved", x=left + x, y=top + y)
    page.wait(".under-mouse", " m")
    told = [float(number) for number in page.text(".under-mouse").removesuffix(" m").split(", ")]
    assert np.abs(np.subtract(told, place))[:2].max() < 0.3
    page.call("Input.dispatchMouseEvent", type="mouseMoved", x=2, y=2)
    page.until("!document.querySelector('.under-mouse')")


def test_the_map_is_grey_below_the_colours_of_the_places(page):
    page.open(f"#/maps/yard?layers=&view={view_of((0, 0, 0), (0, -14, 14))}")
    rainbow = colourful(page.map_picture())
    page.open(f"#/maps/yard?layers=localizability&view={view_of((0, 0, 0), (0, -14, 14))}")
    page.wait("small", "The points are grey below the colours")
    page.until("!document.querySelector('.legend-of-points')")
    heated = page.map_picture()
    close = np.abs(heated.astype(int) - np.array(GREY) * 0.5).max(axis=2) < 90
    assert close.mean() > 0.1
    page.click("label.check", "Where a robot finds itself")
    page.until("!!document.querySelector('.legend-of-points')")
    wait_until(lambda: colourful(page.map_picture()) > 0.8 * rainbow)
    page.click("label.check", "Changes since the map was made")
    page.until("!document.querySelector('.legend-of-points')")
    wait_until(lambda: colourful(page.map_picture()) < 0.5 * rainbow)


def test_points_are_grey_by_their_intensity_where_the_map_has_one(page, world, coarse_version, tmp_path):
    points = np.load(coarse_version.directory / MAP_FILE)[:, :3]
    values = np.where(points[:, 0] < 0, 0, 255).astype(np.uint8)
    CloudOctree.of(points, intensity=Intensity(values, 4.0, 210.0)).save(tmp_path)
    world.service.catalog.publish("bright", tmp_path, Manifest.for_directory(tmp_path))
    page.open(f"#/maps/bright?layers=&view={view_of((0, 0, 0), (0, -0.1, 20))}")
    by_height = colourful(page.map_picture())
    page.choose("Colour", "Intensity")
    page.wait(".legend-of-points", "intensity 210")
    assert "4" in page.text(".legend-of-points .ends")
    picture = page.map_picture()
    assert colourful(picture) < 0.05 * by_height
    middle = picture.shape[1] // 2
    west, east = picture[:, middle - 200 : middle - 20], picture[:, middle + 20 : middle + 200]
    assert np.median(east) > np.median(west) + 80
    assert "colour=intensity" in page.js("location.hash")

    page.open("#/maps/yard?colour=intensity")
    page.map_picture()
    page.wait(".legend-of-points", "floor")
    assert "Intensity" not in page.js("find('select', 'Colour').innerText")
    assert world.service.http.delete("/maps/bright", headers=world.headers("admin")).is_success


def test_versions_say_what_they_are_made_of_and_why_they_differ(page, world, coarse_version, small_version):
    publish = world.service.catalog.publish
    made = [
        Provenance("map_0.1m.pcd", 3_000_000, "a" * 64, note="before the rebuild", caller="key:1", host="b1"),
        Provenance("map_0.05m.laz", 9_000_000, "b" * 64, caller="key:1"),
    ]
    old, new = (
        publish("told", one.directory, one.manifest, provenance=provenance)[:12]
        for one, provenance in zip((coarse_version, small_version), made, strict=True)
    )
    page.open("#/maps/told/versions")
    row = f"tr:has([aria-label='Compare {old}'])"
    page.wait(f"{row} td", "map_0.1m.pcd (3.0 MB)")
    page.wait(f"{row} q", "before the rebuild")
    page.wait(f"{row} small", "by key:1 on b1")
    least = small_version.manifest.self_test["threshold"]["min_probability"]
    page.wait("td", f"{100 * least:g} %")
    page.click("input[type=checkbox]", f"Compare {old}")
    page.click("input[type=checkbox]", f"Compare {new}")
    page.wait("[aria-label='Why they differ'] li", "other files: map_0.1m.pcd and map_0.05m.laz")
    page.wait("[role=status]", "places that both self-tests have")
    page.map_picture()
    assert world.service.http.delete("/maps/told", headers=world.headers("admin")).is_success


def test_a_build_that_has_ended_shows_its_stages_with_their_times(page, world, house):
    build = next(one for one in world.get("/builds", limit=20)["builds"] if one["map_id"] == house)
    with Client(world.service.url, api_key=world.keys["admin"]) as client:
        stages = world.get(f"/builds/{build['build_id']}")["stages"]
        assert client.build_status(build["build_id"]).state == "succeeded"
    page.open()
    page.click("summary", "Earlier builds")
    page.wait(".earlier tr", house)
    page.js(f"find('.earlier tr', '{house}').querySelector('summary').click()")
    for stage in stages:
        page.wait(".earlier dt", stage["stage"].replace("_", " "))
    texts = "[...document.querySelectorAll('.earlier dd')].map((e) => e.innerText)"
    assert all(text.endswith((" s", " min", "earlier build")) for text in page.js(texts))


def test_a_map_is_downloaded_for_foxglove_and_what_is_missing_for_rerun_is_said(page, world):
    page.open("#/maps/yard")
    page.wait("button", "Download .mcap")
    page.wait("small", "for Foxglove, RViz, rerun and ros2 bag")
    page.click("button", "Download .mcap")
    found = messages(page.downloaded(f"yard-{world.versions[1][:12]}.mcap"))
    assert len(points_in(found["/map"][0][1])) == world.get("/maps/yard")["manifest"]["counts"]["map_points"]
    formats = {one["format"]: one for one in world.get("/viewer-formats")}
    is_missing = formats["rrd"]["remedy"] != ""
    assert page.js("find('button', 'Download .rrd').disabled") == is_missing
    if is_missing:
        page.wait("small", "needs rerun: ")
    page.map_picture()


def test_a_dropped_scan_says_what_was_understood_of_it(page, tmp_path):
    file = tmp_path / "scan.pcd"
    file.write_bytes(pcd())
    page.open("#/maps/yard/try")
    page.map_picture()
    page.drop(".panel .drop", file)
    facts = "[aria-label='What was understood of the scan']"
    page.wait(f"{facts} p", "3,000 points")
    page.wait(f"{facts} dd", "application/x-pcd")
    page.wait(f"{facts} dd", "t uint32 as time")
    page.wait(f"{facts} dd", "0 to 99000000 ns")
    page.wait(".answer .verdict")
    page.map_picture()
