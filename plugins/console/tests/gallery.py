"""Makes a picture of each view of the console in its states: at both sizes, light and dark.

    python -m plugins.console.tests.gallery docs/images/console [STATE ...]

It builds its maps (a minute the first time), runs its own services, and leaves one picture a state: a large
and a small screen in the light colours above those in the dark ones. axe-core checks each of these and a
middle size, and nothing may be wider than its place. With exit code 1 some state has a fault: it is said what
and where.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Grant
from firstfix.builds.config import PerturbConfig
from firstfix.engine.index import MapIndex
from firstfix.errors import Conflict
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix
from firstfix.wire.scan import encode_scan
from firstfix_builder.job.build_job import BuildResult
from firstfix_builder.simulation.perturb import perturbed_scans
from firstfix_builder.simulation.simulate import Simulator
from firstfix_client import Client
from plugins.console.tests.accessible import violations
from plugins.console.tests.browser import HOST, Browser, running_browser
from plugins.console.tests.clipped import clipped
from plugins.console.tests.console_world import ConsoleWorld, house, running_console, scans_without_cabin
from plugins.console.tests.page import Page
from tests.once_a_run import OnceARun
from tests.service.service_world import running_service
from tests.small_world import COARSE_CONFIG, CONFIG, SENSOR, SmallWorld, yard
from tests.waiting import wait_until

REPO = Path(__file__).resolve().parents[3]
WORK = REPO / "build" / "gallery"
LARGE, MIDDLE, SMALL = (1440, 900), (1024, 768), (390, 844)
SCALE = 0.5  # of the large screen, in the picture
QUALITY = 72
Posed = tuple[Scan, Matrix]
ROBOTS = ("cart-07", "cart-12", "forklift-3")
SEED = 11
UNSURE_AMONG = 40  # scans of the house
KEYS_KNOWN_S = 1.0  # the service reads new keys ten times a second


class Gallery:
    """The console of one world, and where its pictures go.

    Attributes:
        images: folder of the pictures.
        wanted: names of the states; none: all of them.
        faults: what axe-core has found, and what does not fit, "state, size, colours: fault".
    """

    def __init__(self, browser: Browser, images: Path, wanted: list[str]) -> None:
        self._browser = browser
        self._images = images
        self._wanted = wanted
        self.faults: list[str] = []

    def take(self, state: str, origin: str, key: str | None, show: Callable[[Page], None]) -> None:
        """Brings a page into a state in each size and colour, and keeps the four pictures as one."""
        if self._wanted and state not in self._wanted:
            return
        rows = []
        for scheme in ("light", "dark"):
            pictures = {}
            for size in (LARGE, MIDDLE, SMALL):
                with self._browser.page(origin) as page:
                    page.size(*size)
                    page.prefers(scheme)
                    if key is not None:
                        page.keep_key(key)
                    show(page)
                    pictures[size] = Image.fromarray(page.picture())
                    seen = f"{state}, {size[0]} x {size[1]}, {scheme}"
                    self.faults += [f"{seen}: {one}" for one in violations(page) + clipped(page)]
            rows.append(_beside(pictures[LARGE], pictures[SMALL]))
        whole = Image.new("RGB", (rows[0].width, sum(row.height for row in rows)), "#808080")
        for number, row in enumerate(rows):
            whole.paste(row, (0, number * rows[0].height))
        file = self._images / f"{state}.webp"
        whole.save(file, quality=QUALITY, method=6)
        print(f"{file}: {file.stat().st_size / 1000:.0f} kB", flush=True)


def _beside(large: Image.Image, small: Image.Image) -> Image.Image:
    height = round(LARGE[1] * SCALE)
    parts = [
        large.resize((round(LARGE[0] * SCALE), height), Image.Resampling.LANCZOS),
        small.resize((round(SMALL[0] * height / SMALL[1]), height), Image.Resampling.LANCZOS),
    ]
    row = Image.new("RGB", (sum(part.width for part in parts) + 8, height), "#808080")
    row.paste(parts[0], (0, 0))
    row.paste(parts[1], (parts[0].width + 8, 0))
    return row


def without_maps(gallery: Gallery, folder: Path) -> None:
    """A new service: empty, and open to everyone."""
    with running_service(folder, load=None, zenoh=False) as service:
        origin = f"http://{HOST}:{service.url.rpartition(':')[2]}"

        def empty(page: Page) -> None:
            page.open()
            page.wait(".empty")

        def keys(page: Page) -> None:
            page.open("#/keys")
            page.wait("h1, h2")

        gallery.take("empty", origin, None, empty)
        gallery.take("open-to-everyone", origin, None, keys)


def with_maps(
    gallery: Gallery,
    world: ConsoleWorld,
    place: SmallWorld,
    version: BuildResult,
    alike: BuildResult,
    folder: Path,
) -> None:
    """Views of a service with maps, from the list to an answer."""
    admin = world.keys["admin"]

    def opened(address: str, *words: str) -> Callable[[Page], None]:
        def show(page: Page) -> None:
            page.open(address)
            page.wait(*words)

        return show

    def mapped(address: str) -> Callable[[Page], None]:
        def show(page: Page) -> None:
            page.open(address)
            page.map_picture()

        return show

    def tried(map_id: str, file: Path) -> Callable[[Page], None]:
        def show(page: Page) -> None:
            page.open(f"#/maps/{map_id}/try")
            page.map_picture()
            page.drop(".panel .drop", file)
            page.wait(".verdict")
            page.map_picture()

        return show

    gallery.take("signed-out", world.origin, None, opened("", "button", "Sign in"))
    gallery.take("maps", world.origin, admin, _listed)
    gallery.take("map", world.origin, admin, mapped("#/maps/yard"))
    gallery.take("versions", world.origin, admin, opened("#/maps/yard/versions", "td", "%"))
    gallery.take("activate", world.origin, admin, _asked("tr button", "Activate"))
    gallery.take("retire", world.origin, admin, _asked("tr button", "Retire"))
    gallery.take("earth", world.origin, admin, opened("#/maps/yard/earth", "button", "Set the place"))
    sure = next(file for file, _ in world.scans if world.ask(file)["verdict"] == "localized")
    indoors = _unsure_scan(world, alike, folder)
    gallery.take("localized", world.origin, admin, tried("yard", sure))
    gallery.take("ambiguous", world.origin, admin, tried("house", indoors))
    gallery.take("rejected", world.origin, admin, tried("yard", indoors))
    for file, _ in world.scans[:4]:
        world.ask(file)
    world.ask(indoors)
    world.ask(indoors, map="house")
    gallery.take("recorded-queries", world.origin, admin, opened("#/recorded-queries", "td .verdict"))
    gallery.take("keys", world.origin, admin, opened("#/keys", "th", "a robot"))
    gallery.take("changes", world.origin, admin, _changed(world, place, version, folder))
    gallery.take("live", world.origin, admin, _live(world))
    with _builds(world, folder):
        gallery.take("building", world.origin, admin, opened("", ".stages small"))
        gallery.take("map-building", world.origin, admin, opened("#/maps/office", ".builds progress"))
    gallery.take("failed", world.origin, admin, opened("", ".builds [role=alert]"))
    for number in range(6):
        world.service.catalog.publish(f"hall-{number + 1}", version.directory, version.manifest)
    gallery.take("many-maps", world.origin, admin, _listed)


def _listed(page: Page) -> None:
    """The list of maps with their pictures."""
    page.open()
    page.until(
        "document.querySelectorAll('.thumbnail').length > 1"
        " && [...document.querySelectorAll('.thumbnail')].every((one) => one.querySelector('img')?.complete)"
    )


def _asked(*button: str) -> Callable[[Page], None]:
    """A question about a version."""

    def show(page: Page) -> None:
        page.open("#/maps/yard/versions")
        page.click(*button)
        page.wait("dialog")

    return show


def _scans_of(place: SmallWorld, version: BuildResult, count: int, occluders: int) -> list[Posed]:
    """Scans between the templates of a place's version."""
    return perturbed_scans(
        Simulator(place.vertices, place.triangles),
        SensorModel.from_mapping(SENSOR),
        MapIndex.load(version.directory).cascade.templates.position_m,
        1.0,
        count,
        PerturbConfig(occluders=occluders, unmapped=0, vanished=0),
        np.random.default_rng(SEED),
    )


def _unsure_scan(world: ConsoleWorld, version: BuildResult, folder: Path) -> Path:
    """A scan of the house that could have been taken in both of its storeys."""
    for number, (scan, _) in enumerate(_scans_of(house(), version, UNSURE_AMONG, 0)):
        file = folder / f"indoors-{number}.ffscan"
        file.write_bytes(encode_scan(scan))
        if world.ask(file, map="house")["verdict"] == "ambiguous":
            return file
    raise AssertionError("no scan of the house is ambiguous")


def _changed(
    world: ConsoleWorld, place: SmallWorld, version: BuildResult, folder: Path
) -> Callable[[Page], None]:
    """Robots ask in the yard after its cabin has gone."""
    templates_m = MapIndex.load(version.directory).cascade.templates.position_m
    before = world.looked_at_sightings()
    for number, scan in enumerate(scans_without_cabin(place, templates_m), 1):
        file = folder / f"later-{number}.ffscan"
        file.write_bytes(encode_scan(scan))
        world.ask(file)
        wait_until(lambda number=number: world.looked_at_sightings() >= before + number)

    def show(page: Page) -> None:
        page.open("#/maps/yard?layers=changes")
        page.wait("[aria-label='Changed areas'] li")
        page.map_picture()
        page.js("find('[aria-label=Changes]', '').scrollIntoView({ block: 'end' })")

    return show


def _live(world: ConsoleWorld) -> Callable[[Page], None]:
    """Three robots, each with a key of its own, ask one after the other."""
    keys = ApiKeys(world.service.catalog.store)
    for name in ROBOTS:
        world.keys[name] = keys.create(name, Grant.parse(("localize",), ("yard",)))[1]
    time.sleep(KEYS_KNOWN_S)

    def show(page: Page) -> None:
        page.open("#/live?map=yard")
        page.map_picture()
        for number, (file, _) in enumerate(world.scans[:12]):
            world.ask(file, key=ROBOTS[number % len(ROBOTS)])
        page.until("document.querySelectorAll('.fixes tbody tr').length >= 12")
        page.map_picture()

    return show


@contextlib.contextmanager
def _builds(world: ConsoleWorld, folder: Path) -> Iterator[None]:
    """A build that runs, one behind it, and one before it that failed."""
    broken, building = folder / "broken.ply", folder / "house.ply"
    broken.write_bytes(b"ply\nformat ascii 1.0\nelement vertex 1000000\n")
    house().write(building)
    config = {"sensor": "vlp-16", "activate": {"min_found": 0}}
    with Client(world.service.url, api_key=world.keys["admin"]) as client:
        client.build_map(broken, "depot", config=config)
        running = client.build_map(building, "office", config=config).build_id
        wait_until(lambda: world.get("/builds", limit=5)["builds"][0]["state"] == "running")
        behind = client.build_map(building, "annex", config=config).build_id
        yield
        for build in (behind, running):
            with contextlib.suppress(Conflict):  # it has ended
                client.cancel_build(build)
            wait_until(lambda build=build: client.build_status(build).is_final)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("images", type=Path)
    parser.add_argument("states", nargs="*", help="names of pictures; none: all of them")
    chosen = parser.parse_args()
    chosen.images.mkdir(parents=True, exist_ok=True)
    shared, place = OnceARun(WORK), yard()
    source = shared.folder("yard", lambda folder: place.write(folder / "yard.ply")) / "yard.ply"
    good = shared.version("yard-version", lambda folder: source, CONFIG)
    coarse = shared.version("yard-coarse", lambda folder: source, COARSE_CONFIG)
    alike = shared.version("house-version", lambda folder: house().write(folder / "house.ply"), CONFIG)
    scans = _scans_of(place, good, 20, 3)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for part in ("browser", "empty", "console"):
            (folder / part).mkdir()
        with running_browser(folder / "browser") as browser:
            gallery = Gallery(browser, chosen.images, chosen.states)
            without_maps(gallery, folder / "empty")
            with running_console(folder / "console", HOST, (coarse, good), scans) as world:
                world.service.catalog.publish("house", alike.directory, alike.manifest)
                with_maps(gallery, world, place, good, alike, folder)
    if gallery.faults:
        sys.exit("\n".join(gallery.faults))


if __name__ == "__main__":
    main()
