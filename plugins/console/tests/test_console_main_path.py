"""The console in a real browser, its main path: a sign-in, a map in 3D, a scan tried, an answer, a build."""

from __future__ import annotations

import json

import numpy as np
import pytest

from plugins.console.tests.console_world import room
from plugins.console.tests.pictures import LOCALIZED, PLOT_LOCALIZED, difference, pixels_of
from plugins.console.tests.scans import localized_scan, places_of, said_chance, scan_colours, try_scan
from tests.waiting import wait_until

HEAT = ((229, 72, 77), (255, 197, 61), (48, 164, 108))  # none, half, all


def test_a_caller_signs_in_with_a_key_and_out_again(visitor, world):
    visitor.expected += ["401"]
    visitor.open()
    visitor.fill("API key or token", "ffx_wrong")
    visitor.press("Enter")
    visitor.wait("[role=alert]", "API key")
    visitor.fill("API key or token", world.keys["admin"])
    visitor.click("button", "Sign in")
    visitor.wait("a", "yard")
    assert "key:" in visitor.text(".caller")
    visitor.click("button", "Sign out")
    visitor.wait("button", "Sign in")
    assert visitor.js("sessionStorage.length") == 0


def test_the_heat_of_a_map_has_a_legend(page, world):
    page.open("#/maps/yard?layers=")
    before = page.map_picture()
    page.click("[aria-label='Is it good?'] button", "Show where it is good")
    page.wait("[aria-label='Colours of the places']", "half")
    wait_until(lambda: difference(before, page.map_picture()) > 0.1)
    legend = page.picture(".legend-of-heat .heat")
    assert all(pixels_of(legend, colour, 16) > 0 for colour in HEAT)
    page.until("location.hash.includes('layers=localizability')")


def test_a_dropped_scan_is_laid_over_its_map(page, world):
    file, T_map_sensor, answer = localized_scan(world)
    try_scan(page, file)
    page.wait(".verdict", "localized")
    assert said_chance(page.text(".answer")) == pytest.approx(answer["probability"], abs=6e-4)
    agrees, contradicts = scan_colours(page)
    assert agrees > max(200, 5 * contradicts)

    x, y, z = T_map_sensor[:3, 3]
    page.click("button", "Place by hand")
    for name, value in (("x (m)", -x), ("y (m)", -y), ("z (m)", z)):
        page.fill(name, f"{value:.2f}")
        page.press("Enter")
    page.click("label.check", "Search only around it")
    page.fill("Within (m)", "1")
    page.press("Enter")
    page.until("!find('.verdict', 'localized') && !!find('.places input', '')")
    fits = [said_chance(place["On the map"]) for place in places_of(page)]
    page.click(f".places tbody tr:nth-child({1 + int(np.argmin(fits))})")
    page.wait(f".places tbody tr:nth-child({1 + int(np.argmin(fits))}) input:checked")

    def lies_wrong() -> bool:
        agrees, contradicts = scan_colours(page)
        return contradicts > agrees

    wait_until(lies_wrong)  # the overlay of this place comes after the mark of its row


def test_an_answer_appears_as_it_is_given(page, world):
    file, _, answer = localized_scan(world)
    page.open("#/live?map=yard")
    page.wait("[role=status]", "Connected")
    page.map_picture()
    before = page.text(".fixes tbody tr")  # the newest; rows of other tests may fill the list
    page.js("new Promise((done) => setTimeout(done, 1100 - (Date.now() % 1000)))")  # rows show whole seconds
    world.ask(file, "reader")
    page.until(f"(document.querySelector('.fixes tbody tr')?.innerText ?? '') !== {json.dumps(before)}")
    assert "localized" in page.text(".fixes tbody tr")
    told = said_chance(page.text(".fixes tbody tr"))
    assert told == pytest.approx(answer["probability"], abs=6e-4)
    wait_until(lambda: pixels_of(page.map_picture(), LOCALIZED, 30) > 20)
    wait_until(lambda: pixels_of(page.picture(".plot"), PLOT_LOCALIZED, 60) > 10)


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
    page.drop("dialog .drop", folder)
    page.wait(".drop", "Tower Block: 2 files")
    assert page.js("find('input', 'Name of the map').value") == "tower-block"
    page.choose("Sensor of the robots", "vlp-16")
    page.click("dialog button.primary", "Build")
    page.wait("tr", "tower-block")
    (build,) = world.get("/builds", limit=1)["builds"]
    assert (build["map_id"], build["error"]) == ("tower-block", None)
