"""The console in a real browser, with a real service and real maps: each view, end to end.

All is in one file, because pytest's workers share out files: one browser and one service are enough.
"""

from __future__ import annotations

import json
import os
import subprocess
import zipfile
from itertools import combinations

import numpy as np
import pytest
from accessible import violations
from browser import HOST
from page import CANVAS
from pictures import (
    AGREES,
    CONTRADICTS,
    GONE,
    LOCALIZED,
    difference,
    drawn_pixels,
    pixels_of,
    place_in,
    reddened,
    view_of,
)
from typer.testing import CliRunner

from console_world import room, scans_without_cabin
from firstfix.engine.index import MapIndex
from firstfix.scan.scan import Scan
from firstfix.wire.scan import encode_scan
from firstfix_cli.main import app
from waiting import wait_until

pytestmark = pytest.mark.slow
MARKUP = "<img src=x onerror=alert(1)>"


# Access


def test_a_caller_signs_in_with_a_key_and_out_again(visitor, world):
    visitor.expected += ["401"]
    visitor.open()
    visitor.fill("API key or token", "ffk_wrong")
    visitor.press("Enter")
    visitor.wait("[role=alert]", "API key")
    visitor.fill("API key or token", world.keys["admin"])
    visitor.click("button", "Sign in")
    visitor.wait("a", "yard")
    assert "key:" in visitor.text(".caller")
    visitor.click("button", "Sign out")
    visitor.wait("button", "Sign in")
    assert visitor.js("sessionStorage.length") == 0


def test_what_a_key_may_not_do_is_not_shown(visitor, world):
    visitor.keep_key(world.keys["reader"])
    visitor.open()
    visitor.wait("td", world.versions[1][:12])
    assert visitor.has("a", "Try a scan")
    for words in ("Build a map", "Delete", "Kept queries", "Live", "Keys"):
        assert not visitor.has("button, a", words), words
    visitor.expected += ["403"]
    for view in ("samples", "live", "keys"):
        visitor.open(f"#/{view}")
        visitor.wait("[role=alert]", "scope")


def test_the_views_of_an_empty_service_say_what_to_do_next(visitor, world):
    visitor.keep_key(world.keys["stranger"])
    visitor.open()
    visitor.wait(".empty", "Build one from a cloud")
    visitor.open("#/samples")
    visitor.wait(".empty", "FIRSTFIX_SAMPLES_SHARE")
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
    page.wait("tr .tag", "revoked")
    wait_until(lambda: world.service.http.get("/caller", headers=headers).status_code == 401)


# Maps


def test_a_map_is_built_from_a_dropped_file(page, world, house_file, tmp_path):
    page.open()
    page.click("button", "Build a map")
    page.wait("svg[role=img]", "beams")
    broken = tmp_path / f"{MARKUP}.ply"
    broken.write_bytes(b"ply\nformat ascii 1.0\nelement vertex 1000000\n")
    page.drop(".drop", broken)
    assert page.js("find('input', 'Name of the map').validity.valid")
    page.fill("Name of the map", "broken")
    page.click("dialog button.primary", "Build")
    page.wait(".builds [role=alert]", "ply")
    assert page.count("img") == 0
    page.click("button", "Hide")
    page.until("!find('.builds li', 'broken')")

    _hand_in(page, house_file)
    page.click(".builds button", "Cancel")
    page.until("!document.querySelector('.builds')")
    wait_until(lambda: world.get("/builds", limit=1)["builds"][0]["state"] == "cancelled")

    page.js(
        "globalThis.seen = new Set(); new MutationObserver(() => {"
        " const bar = document.querySelector('.builds .progress');"
        " if (bar) seen.add(bar.innerText.split('\\n')[0]);"
        "}).observe(document.body, { subtree: true, childList: true, characterData: true })"
    )
    _hand_in(page, house_file)
    wait_until(lambda: world.get("/builds", limit=1)["builds"][0]["state"] == "succeeded")
    version = world.get("/maps/house")["active_version"]
    page.wait("tr", version[:12])
    # the stages that the cancelled build had made are not made again, the last one always is
    assert "self test" in page.js("[...seen]")
    page.until("!find('tr .tag', 'provisional')")


def test_a_map_is_built_from_a_dropped_folder(page, world, tmp_path):
    """The folder's hidden files are left out, as the service leaves them out of a folder on its disk."""
    folder = tmp_path / "Tower Block"
    (folder / ".old").mkdir(parents=True)
    for hidden in (".old/shell.ply", ".index"):
        (folder / hidden).write_bytes(b"no map")
    for name, part in room().items():
        part.write(folder / name)
    page.open()
    page.click("button", "Build a map")
    page.wait("svg[role=img]", "beams")
    page.drop(".drop", folder)
    page.wait(".drop", "Tower Block: 2 files")
    assert page.js("find('input', 'Name of the map').value") == "tower-block"
    page.choose("Sensor of the robots", "vlp-16")
    page.click("dialog button.primary", "Build")
    page.wait("tr", "tower-block")
    (build,) = world.get("/builds", limit=1)["builds"]
    assert (build["map_id"], build["error"]) == ("tower-block", None)


def _hand_in(page, file) -> None:
    page.click("button", "Build a map")
    page.wait("svg[role=img]", "beams")  # until then the dialog grows
    page.drop(".drop", file)
    page.choose("Sensor of the robots", "vlp-16")
    page.click("dialog button.primary", "Build")
    page.wait(".builds li", "house")


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
    page.click("label.check", "Changes since the map was made")
    page.wait("[aria-label=Changes] li", "gone: 1")
    page.wait("[aria-label=Changes] li", "new: 0")
    wait_until(lambda: pixels_of(page.map_picture(), GONE, 30) > 0)
    gone = reddened(unmarked, page.map_picture())
    height, width = gone.shape
    x, y = (int(v) for v in place_in(target, target, eye, width, height))
    around = np.zeros_like(gone)
    around[y - 150 : y + 150, x - 180 : x + 180] = True  # the cabin is 3 m long, and its cells a little more
    assert gone[y - 60 : y + 60, x - 60 : x + 60].mean() > 0.8
    assert gone[~around].mean() < 0.001
    page.click("[aria-label=Changes] button", "5.")
    wait_until(lambda: difference(unmarked, page.map_picture()) > 0.05)


def test_a_link_opens_the_same_view(page, house):
    page.open(f"#/maps/{house}")
    first = page.map_picture()
    page.choose("Colour", "Normal")
    page.drag((400, 400), (520, 330))
    page.until("location.hash.includes('view=')")
    moved = page.map_picture()
    assert difference(first, moved) > 0.05
    link = page.js("location.hash")
    page.open(link)
    assert difference(moved, page.map_picture()) < 0.03  # the link says centimetres
    page.click("button", "Whole map")
    page.choose("Colour", "Height")
    assert difference(first, page.map_picture()) < 0.01


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


# A scan


def test_a_dropped_scan_is_laid_over_its_map(page, world):
    file, T_map_sensor, answer = _localized(world)
    _try(page, file)
    page.wait(".verdict", "localized")
    assert f"{100 * answer['probability']:.1f} %" in page.text(".answer")
    agrees, contradicts = _colours(page)
    assert agrees > max(200, 5 * contradicts)

    x, y, z = T_map_sensor[:3, 3]
    page.click("button", "Place by hand")
    for name, value in (("x (m)", -x), ("y (m)", -y), ("z (m)", z)):
        page.fill(name, f"{value:.2f}")
        page.press("Enter")
    page.fill("Within (m)", "1")
    page.press("Enter")
    page.until("!find('.verdict', 'localized') && !!find('.hypotheses button', '')")
    fits = page.js("[...document.querySelectorAll('.hypotheses small')].map((e) => parseFloat(e.innerText))")
    page.click(f".hypotheses li:nth-child({1 + int(np.argmin(fits))}) button")
    page.wait(f".hypotheses li:nth-child({1 + int(np.argmin(fits))}) button[aria-pressed=true]")
    agrees, contradicts = _colours(page)
    assert contradicts > agrees


def test_the_other_places_of_a_scan_are_looked_at(page, world):
    file = next(file for file, _ in world.scans if len(world.ask(file)["hypotheses"]) > 1)
    _try(page, file)
    page.wait(".hypotheses button[aria-pressed=true]")
    first, colours = page.map_picture(), _colours(page)
    page.click(".hypotheses li:nth-child(2) button")
    page.wait(".hypotheses li:nth-child(2) button[aria-pressed=true]")
    wait_until(lambda: difference(first, page.map_picture()) > 0.02)
    page.click(".hypotheses li:first-child button")
    wait_until(lambda: _colours(page) == colours)


def test_the_least_probability_decides(page, world):
    file, _, answer = _localized(world)
    _try(page, file)
    page.wait(".verdict", "localized")
    page.slide("Least probability", 1.0)
    page.until("!find('.verdict', 'localized')")
    assert world.ask(file, min_probability="1.0")["verdict"] == page.text(".verdict")
    page.slide("Least probability", round(answer["probability"] - 0.01, 2))
    page.wait(".verdict", "localized")


def test_a_copied_command_asks_the_same(page, world):
    file, _, answer = _localized(world)
    _try(page, file)
    page.wait(".verdict", "localized")
    page.slide("Least probability", 0.5)
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
    strange = tmp_path / "notes.txt"
    strange.write_text("nothing")
    _try(page, strange)
    page.wait("[role=alert]", "notes.txt is no scan")
    broken = tmp_path / "broken.pcd"
    broken.write_text("VERSION .7\nFIELDS x y z\n")
    page.drop(".panel .drop", broken)
    page.wait("[role=alert]", "PCD")


# Kept queries


def test_a_kept_query_is_looked_at_judged_and_exported(page, world, tmp_path):
    file, _, _ = _localized(world)
    world.ask(file)
    rng = np.random.default_rng(1)
    elsewhere = tmp_path / "elsewhere.ffscan"
    elsewhere.write_bytes(encode_scan(Scan.from_points(rng.uniform(-6, 6, (4000, 3)))))
    assert world.ask(elsewhere)["verdict"] == "rejected"
    wait_until(lambda: {one["answer"]["verdict"] for one in _kept(world)} >= {"localized", "rejected"})

    page.open("#/samples")
    page.choose("Map", "yard")
    page.choose("Verdict", "rejected")
    page.until("!find('td .verdict', 'localized') && !!find('td .verdict', 'rejected')")
    page.click("tr a", "Look")
    page.wait(".answer .verdict", "rejected")
    page.click("button", "Not in this map")
    page.wait("[role=status]", "Noted")

    page.open("#/samples")
    page.choose("Map", "yard")
    page.wait("td", "not in the map")
    page.choose("Verdict", "localized")
    page.until("!find('td .verdict', 'rejected')")
    page.click("tr a", "Look")
    page.wait(".answer .verdict", "localized")
    page.click("button", "At the place shown")
    page.wait("[role=status]", "Noted")

    page.open("#/samples")
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


def _kept(world):
    return world.get("/samples", map_id="yard", limit=1000)["samples"]


# Versions


def test_versions_are_compared_activated_rolled_back_and_retired(page, world):
    old, new = (version[:12] for version in world.versions)
    page.open("#/maps/yard/versions")
    page.wait("tr .tag", "active")
    page.click("input[type=checkbox]", f"Compare {old}")
    page.click("input[type=checkbox]", f"Compare {new}")
    page.wait("[aria-label=Comparison] td", "643")
    page.wait("[role=status]", "places that both self-tests have")
    page.click(f"tr:has([aria-label='Compare {old}']) button", "Activate")
    page.wait(f"tr:has([aria-label='Compare {old}']) .tag", "active")
    assert world.get("/maps/yard")["active_version"] == world.versions[0]
    page.click("button", "Roll back")
    page.wait(f"tr:has([aria-label='Compare {new}']) .tag", "active")
    assert world.get("/maps/yard")["active_version"] == world.versions[1]
    page.click(f"tr:has([aria-label='Compare {old}']) button", "Retire")
    page.until(f"!find('tr', '{old}')")
    assert [one["version"] for one in world.get("/maps/yard/versions")["versions"]] == [world.versions[1]]


# Live


def test_an_answer_appears_as_it_is_given(page, world):
    file, _, answer = _localized(world)
    page.open("#/live?map=yard")
    page.wait("[role=status]", "Connected")
    page.map_picture()
    before = page.js("document.querySelectorAll('.fixes tbody tr').length")
    world.ask(file, "reader")
    page.until(f"document.querySelectorAll('.fixes tbody tr').length > {before}")
    assert "localized" in page.text(".fixes tbody tr")
    assert f"{100 * answer['probability']:.1f} %" in page.text(".fixes tbody tr")
    wait_until(lambda: pixels_of(page.map_picture(), LOCALIZED, 30) > 20)
    page.js("document.querySelector('.uplot canvas').width > 0")


# Good manners


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
    page.wait("dialog svg[role=img]")
    assert not violations(page)
    assert page.js("!!document.activeElement.closest('dialog')")
    page.press("Escape")
    page.until("!document.querySelector('dialog')")
    assert page.js("document.activeElement === find('button', 'Build a map')")


def _tab_to(page, selector: str, words: str = "") -> None:
    for _ in range(60):
        page.press("Tab")
        if page.js(f"document.activeElement === find({json.dumps(selector)}, {json.dumps(words)})"):
            return
    raise AssertionError(f"the Tab key does not lead to {selector} {words!r}")


@pytest.mark.parametrize(
    "view", ["maps/yard/try", "live?map=yard", "maps/yard", "samples", "", "maps/yard/versions"]
)
def test_a_phone_shows_a_view_without_scrolling_sideways(page, world, view):
    page.size(390, 844, phone=True)
    if view == "samples":
        world.ask(_localized(world)[0])
        wait_until(lambda: _kept(world))
    page.open(f"#/{view}")
    page.wait("td .verdict" if view == "samples" else "h1, h2")
    if "yard" in view and "versions" not in view:
        page.map_picture()
        assert page.box(CANVAS)[3] > 200
    if view == "maps/yard/try":
        page.drop(".panel .drop", _localized(world)[0])
        page.wait(".verdict", "localized")
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


def _try(page, file) -> None:
    page.open("#/maps/yard/try")
    page.map_picture()
    page.drop(".panel .drop", file)


def _colours(page) -> tuple[int, int]:
    """Pixels of points that agree and that contradict, once the scan is laid over the map."""
    page.wait(".key", "on the map")
    picture = page.map_picture()
    return pixels_of(picture, AGREES), pixels_of(picture, CONTRADICTS)


def _localized(world):
    """A scan that the yard's service localizes: (file, T_map_sensor, answer)."""
    for file, T_map_sensor in world.scans:
        answer = world.ask(file)
        if answer["verdict"] == "localized":
            return file, T_map_sensor, answer
    raise AssertionError("no scan of the yard is localized")
