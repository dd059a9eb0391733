"""Queries to real query workers and real versions, during changes and failures."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import numpy as np
import pytest

from firstfix.answer.localization import Localization
from firstfix.catalog.manifest import Manifest
from firstfix.engine.config import ENGINE_FILE
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.transform import pose_error
from firstfix.wire.scan import MEDIA_TYPE, encode_scan
from tests.service.query_worker_pids import Workers
from tests.service.service_world import Service, running_service
from tests.waiting import LIMIT_S, let_pass, wait_until

SHIFT_M = 100.0  # shift between versions, by which they are recognised
pytestmark = pytest.mark.slow


class Yards:
    """Real versions with different positions of the yard."""

    def __init__(self, small_version, small_scans, folder: Path) -> None:
        self._source = small_version.directory
        self._folder = folder
        localizer = Localizer(MapIndex.load(self._source))
        self.asked = []  # (body, T_map_sensor in the yard) of scans that are found
        for scan, truth in small_scans:
            answer = localizer.localize(scan)
            if answer.hypotheses and pose_error(truth, answer.hypotheses[0].T_map_sensor)[0] < 0.2:
                self.asked.append((encode_scan(scan), answer.hypotheses[0].T_map_sensor))
        assert len(self.asked) >= 10

    def publish(self, service: Service, map_id: str, k: int) -> str:
        directory = self._folder / f"shifted-{k}"
        if not directory.exists():
            shutil.copytree(self._source, directory)
            engine = json.loads((directory / ENGINE_FILE).read_text())
            engine["T_map_level"][3] += SHIFT_M * k
            (directory / ENGINE_FILE).write_text(json.dumps(engine))
        return service.catalog.publish(map_id, directory, Manifest.for_directory(directory))

    def shift_of(self, answer: Localization, query: int) -> int:
        """Number of the version that answered, found by its pose."""
        _, T = self.asked[query % len(self.asked)]
        found = answer.hypotheses[0].T_map_sensor
        k = round((found[0, 3] - T[0, 3]) / SHIFT_M)
        moved = T.copy()
        moved[0, 3] += SHIFT_M * k
        assert pose_error(moved, found)[0] < 0.05
        return k

    def ask(self, service: Service, map_id: str, query: int) -> httpx.Response:
        body, _ = self.asked[query % len(self.asked)]
        headers = {"Content-Type": MEDIA_TYPE}
        return service.http.post("/localize", params={"map": map_id}, content=body, headers=headers)


@pytest.fixture(scope="module")
def yards(small_version, small_scans, tmp_path_factory) -> Yards:
    return Yards(small_version, small_scans, tmp_path_factory.mktemp("yards"))


@pytest.fixture
def workers() -> Workers:
    return Workers()


@pytest.fixture
def service(tmp_path: Path, workers: Workers) -> Iterator[Service]:
    with running_service(tmp_path, zenoh=False, load=None, max_versions=3, queue_size=64) as running:
        yield running


def mapped_versions(pid: int) -> set[str]:
    """Returns the digests of the versions whose files a process has mapped."""

    def seen() -> set[str]:
        return set(re.findall(r"/versions/([0-9a-f]{64})/", Path(f"/proc/{pid}/maps").read_text()))

    return seen() & seen()  # one read is not a snapshot: versions may change meanwhile


def rss_mib(pid: int) -> float:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


def test_ten_maps_are_answered_while_three_fit(service: Service, workers: Workers, yards: Yards):
    names = {f"yard-{k}": k for k in range(10)}
    for name, k in names.items():
        yards.publish(service, name, k)
    mapped: list[int] = []

    def ask(query: int) -> None:
        name = f"yard-{query % 10}" if query < 20 else f"yard-{rng.integers(10)}"
        response = yards.ask(service, name, query)
        assert response.status_code == 200, response.text
        answer = Localization.from_mapping(response.json())
        assert answer.map_id == name
        assert yards.shift_of(answer, query) == names[name]
        mapped.extend(len(mapped_versions(pid)) for pid in workers.pids())

    rng = np.random.default_rng(2)
    for query in range(20):
        ask(query)
    before = [rss_mib(pid) for pid in workers.pids()]
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(ask, range(20, 80)))
    assert max(mapped) == 3, "no worker process holds more"
    after = [rss_mib(pid) for pid in workers.pids()]
    assert len(after) == len(before) == 2
    assert max(after) < max(before) + 100, "it does not grow with every load"


def test_a_version_is_swapped_under_queries_without_an_error(service: Service, yards: Yards):
    yards.publish(service, "yard", 0)
    end = threading.Event()

    def ask(first: int) -> list[int]:
        versions = []
        query = first
        is_last = False
        while not is_last:
            is_last = end.is_set()  # so the last query begins after the end
            response = yards.ask(service, "yard", query)
            assert response.status_code == 200, response.text
            versions.append(yards.shift_of(Localization.from_mapping(response.json()), query))
            query += 1
        return versions

    with ThreadPoolExecutor(4) as threads:
        asking = [threads.submit(ask, k) for k in range(4)]
        try:
            wait_until(lambda: service.http.get("/readyz").is_success)
            wanted = 0
            for wanted in (1, 2):
                let_pass(1)  # queries use the version before
                version = yards.publish(service, "yard", wanted)
                wait_until(lambda v=version: _serves(service, yards, v))
        finally:
            end.set()
        for asked in asking:
            versions = asked.result(LIMIT_S)
            assert versions == sorted(versions), "nobody sees the old one after the new one"
            assert versions[-1] == wanted


def _serves(service: Service, yards: Yards, version: str) -> bool:
    return bool(yards.ask(service, "yard", 0).json()["map_version"] == version)


def test_killed_workers_are_replaced_under_queries(service: Service, workers: Workers, yards: Yards):
    yards.publish(service, "yard", 1)
    assert yards.ask(service, "yard", 0).status_code == 200
    end = threading.Event()
    outcomes: list[str] = []

    def ask(first: int) -> None:
        query = first
        while not end.is_set():
            response = yards.ask(service, "yard", query)
            if response.status_code == 200:
                assert yards.shift_of(Localization.from_mapping(response.json()), query) == 1
                outcomes.append("ok")
            else:
                outcomes.append(response.json()["code"])
                assert "retry-after" in response.headers
            query += 1

    with ThreadPoolExecutor(4) as threads:
        asking = [threads.submit(ask, k) for k in range(4)]
        try:
            for _ in range(4):
                wait_until(lambda: len(workers.pids()) == 2)
                os.kill(workers.pids()[0], signal.SIGKILL)
                answered = outcomes.count("ok")
                wait_until(lambda n=answered: outcomes.count("ok") >= n + 5)
        finally:
            end.set()
        for asked in asking:
            asked.result(LIMIT_S)
    assert set(outcomes) <= {"ok", "worker_lost"}
    wait_until(lambda: "firstfix_worker_deaths_total 4.0" in service.http.get("/metrics").text)
