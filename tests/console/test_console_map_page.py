"""The console in a real browser: the page of a map. Is it good, what is on it, and can it be read?

Only four files have its tests: each worker of pytest that has one starts a browser and a service.
"""

from __future__ import annotations

import pytest
from page import CANVAS
from pictures import difference, drawn_pixels, pixels_of

from waiting import wait_until

pytestmark = pytest.mark.slow

HEAT = ((229, 72, 77), (255, 197, 61), (48, 164, 108))  # none, half, all


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
        "doc": "docs/how-to/is-my-map-good.md",
    }
    manifest = small_version.manifest
    told = type(manifest)(**{**vars(manifest), "source": {**manifest.source, "findings": [finding]}})
    world.service.catalog.publish("rounded", small_version.directory, told)
    page.open("#/maps/rounded")
    page.wait(".findings .warning", finding["text"])
    page.wait(".findings .warning", finding["remedy"])
    page.map_picture()  # all of it is there before the map goes
    assert world.service.http.delete("/maps/rounded", headers=world.headers("admin")).is_success


def test_the_heat_of_a_map_has_a_legend(page, world):
    page.open("#/maps/yard?layers=")
    before = page.map_picture()
    page.click("[aria-label='Is it good?'] button", "Show where it is good")
    page.wait("[aria-label='Colours of the places']", "half")
    wait_until(lambda: difference(before, page.map_picture()) > 0.1)
    legend = page.picture(".legend-of-heat .heat")
    assert all(pixels_of(legend, colour, 16) > 0 for colour in HEAT)
    page.until("location.hash.includes('layers=localizability')")


def test_versions_and_kept_queries_of_a_map_are_on_its_page(page, world):
    world.ask(world.scans[0][0])
    older = world.versions[0][:12]
    page.open("#/maps/yard")
    page.map_picture()
    page.wait("[aria-label='Kept queries of the map'] li")
    page.press("t")
    page.until("location.hash.includes('view=')")
    view = page.js("new URLSearchParams(location.hash.split('?')[1]).get('view')")
    page.click("[aria-label='Versions of the map'] button", older)
    page.wait("[aria-label='Is it good?'] .tag", "not active")
    page.until(f"location.hash.includes('version={world.versions[0]}')")
    page.map_picture()
    assert page.js("new URLSearchParams(location.hash.split('?')[1]).get('view')") == view, "as from before"
    before = page.map_picture()
    page.click("label.check", "Kept queries, by verdict")
    wait_until(lambda: difference(before, page.map_picture()) > 0.0001)
    page.click("[aria-label='Kept queries of the map'] a", "Look")
    page.until("location.hash.includes('/try?sample=')")


def test_the_keys_of_the_picture_are_listed_and_work_from_the_page(page):
    page.open("#/maps/yard?layers=")
    before = page.map_picture()
    page.wait(".keys button", "Keys: ?")
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
