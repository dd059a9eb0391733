"""Callers of a service whose power is cut, and what it acknowledged: for ``power_cuts``."""

from __future__ import annotations

import base64
import random
import threading
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

import httpx

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.log.map_log import Event
from firstfix.errors import FirstfixError
from firstfix.store.store import Store

from .kill_deployment import Deployment

MAPS = ("hall", "yard")
PART_BYTES, PARTS = 300_000, 4


@dataclass
class Acknowledged:
    """Everything that the service acknowledged."""

    builds: set[str] = field(default_factory=set)
    succeeded: dict[str, tuple[str, str]] = field(default_factory=dict)  # build to map and version
    upload_bytes: dict[str, int] = field(default_factory=dict)
    switches: Counter[str] = field(default_factory=Counter)  # of each map

    def missing_in(self, catalog: Catalog) -> list[str]:
        """The acknowledged things that a store has lost."""
        lost = [f"build {name}" for name in sorted(self.builds - set(catalog.builds.ids()))]
        for build_id, (map_id, version) in self.succeeded.items():
            if catalog.builds.status(build_id)["version"] != version:
                lost.append(f"the end of build {build_id}")
            if version not in catalog.state(map_id).published:
                lost.append(f"version {version[:12]} of {map_id}")
        for map_id, count in self.switches.items():
            entries = catalog.log(map_id)
            if sum(not e.build_id and e.event is Event.ACTIVATED for e in entries) < count:
                lost.append(f"a switch of {map_id}")
        for upload_id, size in self.upload_bytes.items():
            parts = catalog.store.scan(f"uploads/{upload_id}/parts")
            if sum(part.size_bytes for part in parts) < size:
                lost.append(f"bytes of upload {upload_id}")
        return lost


class Callers:
    """Callers until the service is gone: one uploads, one hands in maps, one switches versions."""

    def __init__(self, deployment: Deployment, said: Acknowledged, seed: int) -> None:
        self._http = httpx.Client(base_url=f"http://127.0.0.1:{deployment.port}", timeout=60.0)
        self._deployment = deployment
        self._catalog = Catalog(Store.open(deployment.store_url))
        self._said = said
        self._rng = random.Random(seed)
        self._stop = threading.Event()
        works = (self._upload, self._hand_in, self._switch)
        self._threads = [threading.Thread(target=self._run, args=(work,)) for work in works]
        self.is_uploading = False
        self.hands_in = True

    def start(self) -> None:
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join()
        self._http.close()

    def _run(self, work: Callable[[], None]) -> None:
        while not self._stop.is_set():
            with suppress(httpx.HTTPError, FirstfixError, KeyError, ValueError):  # the power is gone
                work()
            self._stop.wait(0.05)

    def _upload(self) -> None:
        if not self._said.upload_bytes:  # else it goes on with the one that the power cut met
            name = base64.b64encode(b"a.xyz").decode()
            headers = {"Upload-Length": str(PARTS * PART_BYTES), "Upload-Metadata": f"filename {name}"}
            begun = self._http.post("/uploads", headers=headers)
            if begun.status_code != 201:
                return
            self._said.upload_bytes[begun.headers["Location"].rsplit("/", 1)[-1]] = 0
        (upload_id,) = self._said.upload_bytes
        there = self._http.head(f"/uploads/{upload_id}")
        for part in range(int(there.headers["Upload-Offset"]) // PART_BYTES, PARTS):
            if self._stop.is_set():
                return
            self.is_uploading = True
            answer = self._http.patch(
                f"/uploads/{upload_id}",
                content=bytes([48 + part]) * PART_BYTES,
                headers={
                    "Upload-Offset": str(part * PART_BYTES),
                    "Content-Type": "application/offset+octet-stream",
                },
            )
            self.is_uploading = False
            if answer.status_code != 204:
                return
            self._said.upload_bytes[upload_id] = int(answer.headers["Upload-Offset"])
        del self._said.upload_bytes[upload_id]  # it is removed
        self._http.delete(f"/uploads/{upload_id}")

    def _hand_in(self) -> None:
        for build_id in self._said.builds - self._said.succeeded.keys():
            status = self._http.get(f"/builds/{build_id}").json()
            if status["state"] == "succeeded":
                self._said.succeeded[build_id] = (status["map_id"], status["version"])
        if self.hands_in and len(self._said.builds - self._said.succeeded.keys()) < 3:
            number = self._rng.randrange(10**9)
            build_id = self._deployment.post(MAPS[number % len(MAPS)], number)
            if build_id is not None:
                self._said.builds.add(build_id)

    def _switch(self) -> None:
        map_id = self._rng.choice(MAPS)
        self._stop.wait(0.5)
        # Past the service, which would want to load the version: there is no index in a tiny worker's.
        self._catalog.roll_back(map_id)
        self._said.switches[map_id] += 1
