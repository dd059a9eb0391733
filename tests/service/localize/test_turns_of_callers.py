"""One caller floods a map with all that it may ask; another one asks the same map, and is answered."""

from __future__ import annotations

import threading
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest
import zenoh

from firstfix.answer.localization import Localization
from tests.service.access_world import give
from tests.service.service_world import (
    SCAN_BODY,
    XYZ,
    Behaviour,
    FakeLocalizer,
    Service,
    client_session,
    publish,
    running_service,
)
from tests.waiting import LIMIT_S, let_pass, wait_until

pytestmark = pytest.mark.slow

HEAVY_BODY = bytes(12 * 5000)
HEAVY_S = 0.6
FLOOD, ASKED = 60, 15
AGAIN_S = 0.1  # after a refusal, so that the flood takes the queue and not the processor


class Laborious(Behaviour):
    """Takes its time with large scans."""

    def load(self, directory: Path) -> FakeLocalizer:
        return LaboriousLocalizer(1.0, self)


class LaboriousLocalizer(FakeLocalizer):
    def localize(self, scan, options=None, *_: object) -> Localization:
        let_pass(HEAVY_S if len(scan) >= 5000 else 0.0)
        return super().localize(scan, options)


def flood_over_http(service: Service, key: str, ended: threading.Event, seen: Counter[int]) -> None:
    headers = {"Content-Type": XYZ, "Authorization": f"Bearer {key}"}
    with httpx.Client(base_url=service.url, timeout=LIMIT_S) as http:
        while not ended.is_set():
            answer = http.post("/localize?map=hall", content=HEAVY_BODY, headers=headers)
            seen[answer.status_code] += 1
            if answer.status_code == 503:
                assert int(answer.headers["retry-after"]) >= 1
                let_pass(AGAIN_S)


def flood_over_zenoh(service: Service, key: str, ended: threading.Event, seen: Counter[int]) -> None:
    session = client_session(service.endpoint)
    while not ended.is_set():
        asked = session.get(
            "firstfix/hall/localize", payload=HEAVY_BODY, encoding=XYZ, attachment=key, timeout=LIMIT_S
        )
        for reply in asked:
            seen[200 if reply.ok is not None else 503] += 1
            let_pass(0 if reply.ok is not None else AGAIN_S)
    session.close()


@pytest.mark.parametrize(
    ("flood", "transport"),
    [(flood_over_http, "zenoh"), (flood_over_zenoh, "http")],
    ids=["http flood", "zenoh flood"],
)
def test_every_query_is_answered_beside_a_flood_of_heavy_ones(tmp_path: Path, flood, transport: str):
    seen: Counter[int] = Counter()
    ended = threading.Event()
    with (
        running_service(tmp_path, behaviour=Laborious(), auth="on", keys_refresh_s=0.1) as service,
        ThreadPoolExecutor(FLOOD) as threads,
    ):
        publish(service.catalog, "hall", "1", service.scratch)
        theirs, ours = give(service, "localize"), give(service, "localize")
        wait_until(lambda: ask(service, transport, ours))
        flooding = [threads.submit(flood, service, theirs, ended, seen) for _ in range(FLOOD)]
        try:
            wait_until(lambda: seen[503] > FLOOD)  # the queue is full, and they come again
            answered = []
            for _ in range(ASKED):
                answered.append(ask(service, transport, ours))
                let_pass(0.1)
        finally:
            ended.set()
        for one in flooding:
            one.result(LIMIT_S)
    assert answered == [True] * ASKED
    assert seen[200], "the flood is answered, too, as far as there is time"


def ask(service: Service, transport: str, key: str) -> bool:
    if transport == "http":
        headers = {"Content-Type": XYZ, "Authorization": f"Bearer {key}"}
        return service.http.post("/localize?map=hall", content=SCAN_BODY, headers=headers).is_success
    replies = list(
        service.session.get(
            zenoh.Selector("firstfix/hall/localize", {}),
            payload=SCAN_BODY,
            encoding=XYZ,
            attachment=key,
            timeout=LIMIT_S,
        )
    )
    return [reply.ok is not None for reply in replies] == [True]
