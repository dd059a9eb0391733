"""A query that names none of 41 maps: the right one of those that its caller may see is found and named."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest

from firstfix.answer.localization import Verdict
from firstfix.catalog.manifest import FILE_NAME, Manifest
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix_service.query_workers.query import CHOSEN_MAPS
from firstfix_service.query_workers.worker import load_localizer
from tests.service.access_world import get, give
from tests.service.service_world import Service, running_service
from tests.small_world import COARSE_CONFIG, SmallWorld
from tests.waiting import wait_until

pytestmark = pytest.mark.slow
TYPE = "application/vnd.firstfix.xyz"
MIRRORED = 40


@pytest.fixture(scope="module")
def mirrored(small_world, once_a_run) -> Path:
    """Version of the mirrored yard: it looks alike, but no rotation fits."""
    world = SmallWorld(small_world.vertices * [1, -1, 1], small_world.triangles[:, ::-1])
    built = once_a_run.version("mirrored", lambda folder: world.write(folder / "m.ply"), COARSE_CONFIG)
    return Path(built.directory)


def publish(service: Service, map_id: str, version: Path) -> None:
    """Publishes a version of its own, whose files are those of another one."""
    directory = service.scratch / map_id
    directory.mkdir(parents=True)
    for path in version.iterdir():
        if path.name != FILE_NAME:
            os.link(path, directory / path.name)
    (directory / "mark.txt").write_text(map_id)
    service.catalog.publish(map_id, directory, Manifest.for_directory(directory))


def key_of(service: Service, scope: str, maps: tuple[str, ...] = ("*",)) -> str:
    """A key that the service knows."""
    key = give(service, scope, maps=maps)
    wait_until(lambda: get(service, "/maps", key).status_code != 401)
    return key


def wait_for(service: Service, maps: int) -> None:
    """Waits until the coarse index has so many maps."""
    key = key_of(service, "admin")
    wait_until(lambda: f"\nfirstfix_coarse_maps {maps:.1f}\n" in get(service, "/metrics", key).text)


@pytest.fixture(scope="module")
def service(tmp_path_factory, mirrored: Path, small_version) -> Iterator[Service]:
    """A service that was running while the last maps came."""
    folder = tmp_path_factory.mktemp("service")
    with running_service(
        folder, load=load_localizer, zenoh=False, auth="on", keys_refresh_s=0.1, workers=1
    ) as running:
        for number in range(20):
            publish(running, f"m{number:02}", mirrored)
        wait_for(running, 20)
        for number in range(20, MIRRORED):
            publish(running, f"m{number:02}", mirrored)
        publish(running, "yard", small_version.directory)
        wait_for(running, MIRRORED + 1)
        yield running


def ask(service: Service, key: str, content: bytes, **options: str) -> httpx.Response:
    headers = {"Content-Type": TYPE, "Authorization": f"Bearer {key}"}
    return service.http.post("/localize", params=options, content=content, headers=headers)


def body_of(scan) -> bytes:
    return np.ascontiguousarray(scan.points, "<f4").tobytes()


def test_the_right_map_is_named(service: Service, small_scans, small_version):
    alone, key = Localizer(MapIndex.load(small_version.directory)), key_of(service, "localize")
    named = [scan for scan, _ in small_scans[:6] if alone.localize(scan).verdict is Verdict.LOCALIZED]
    assert len(named) >= 3
    for scan in named:
        response = ask(service, key, body_of(scan))
        answer = response.json()
        assert answer["hypotheses"][0]["map_id"] == "yard"
        assert answer["verdict"] != "localized" or answer["map_id"] == "yard"
        assert "choose;dur=" in response.headers["Server-Timing"]
        last = answer["findings"][-1]
        assert (last["code"], last["severity"]) == ("maps_left_out", "info")
        assert last["numbers"] == {"searched": CHOSEN_MAPS, "maps": MIRRORED + 1}
        assert f"{CHOSEN_MAPS} of {MIRRORED + 1} maps" in last["text"]


def test_no_map_is_reported_as_left_out_where_all_are_searched(service: Service, small_scans):
    body, all_maps = body_of(small_scans[0][0]), key_of(service, "localize")
    few = key_of(service, "localize", maps=("yard", "m1?"))
    for answer in (ask(service, few, body), ask(service, all_maps, body, map="yard,m00")):
        assert "maps_left_out" not in {one["code"] for one in answer.json()["findings"]}


def test_maps_of_others_are_neither_searched_nor_named(service: Service, small_scans):
    key = key_of(service, "localize", maps=("m*",))
    answer = ask(service, key, body_of(small_scans[0][0])).json()
    assert {one["map_id"] for one in answer["hypotheses"]} <= {f"m{k:02}" for k in range(MIRRORED)}
    assert answer["findings"][-1]["numbers"]["maps"] == MIRRORED
    one = key_of(service, "localize", maps=("yard",))
    assert ask(service, one, body_of(small_scans[0][0])).json()["map_id"] in ("yard", "")


def test_bad_input_is_refused(service: Service, small_scans):
    key, body = key_of(service, "localize"), body_of(small_scans[0][0])
    assert ask(service, key, body[:-1]).json()["code"] == "malformed_data"
    assert ask(service, key, body, prior="0,0,0,2").json()["code"] == "invalid_option"
    assert ask(service, key, body, version="0" * 64).json()["code"] == "invalid_option"
    many = ",".join(f"m{k:02}" for k in range(17))
    assert "up to 16" in ask(service, key, body, map=many).json()["detail"]
    few = np.ones((20, 3), "<f4").tobytes()
    assert ask(service, key, few).json()["reasons"] == ["too_few_points"]


def test_a_removed_map_is_not_named(service: Service, small_scans):
    service.catalog.remove_map("yard")
    wait_for(service, MIRRORED)
    answer = ask(service, key_of(service, "localize"), body_of(small_scans[0][0])).json()
    assert answer["map_id"] != "yard"
    assert "yard" not in {one["map_id"] for one in answer["hypotheses"]}
