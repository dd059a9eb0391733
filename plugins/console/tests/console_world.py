"""A running service with real maps, as the console's tests see it: keys of all kinds, and scans."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Grant
from firstfix.builds.config import PerturbConfig
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix
from firstfix.wire.scan import encode_scan
from firstfix_builder.simulation.perturb import perturbed_scans
from firstfix_builder.simulation.simulate import Simulator
from firstfix_service.http_api.parts import MapParts
from tests.service.service_world import Service, running_service
from tests.service.token_world import ALL_KEYS, AUDIENCE, ISSUER, signed
from tests.small_world import SENSOR, SmallWorld
from tests.storey_world import Box, mesh_of
from tests.waiting import wait_until

if TYPE_CHECKING:  # open3d
    from firstfix_builder.job.build_job import BuildResult

STOREY_M = 3.0
BOX_TRIANGLES = 12
MARKUP = "<img src=x onerror=alert(1)>"


@dataclass(frozen=True)
class ConsoleWorld:
    """A service with the map "yard" in two versions, the better one active.

    Attributes:
        keys: API keys by what they may do: admin, reader (localize), stranger (admin of no map). ``token`` is
            that of an admin whose name is MARKUP.
        scans: (file, T_map_sensor) of scans in the yard.
    """

    service: Service
    origin: str
    keys: dict[str, str]
    scans: list[tuple[Path, Matrix]]
    versions: tuple[str, str]

    def ask(self, scan: Path, key: str = "admin", **query: str) -> dict[str, Any]:
        """Localizes a scan as a robot does."""
        answer = self.service.http.post(
            "/localize",
            params={"map": "yard", **query},
            content=scan.read_bytes(),
            headers={**self.headers(key), "Content-Type": "application/vnd.firstfix.scan"},
        )
        assert answer.status_code == 200, answer.text
        return dict(answer.json())

    def get(self, path: str, **query: Any) -> Any:
        answer = self.service.http.get(path, params=query, headers=self.headers("admin"))
        assert answer.status_code == 200, answer.text
        return answer.json()

    def recorded(self) -> list[dict[str, Any]]:
        """The recorded queries of the yard."""
        return list(self.get("/recorded-queries", map_id="yard", limit=1000)["queries"])

    def looked_at_sightings(self) -> int:
        """Number of sure answers that the query workers have looked at for changes of the map."""
        self.get("/maps/yard/changes")  # takes the counts from the workers
        lines = self.service.http.get("/metrics", headers=self.headers("admin")).text.splitlines()
        return sum(
            int(float(line.split()[-1])) for line in lines if line.startswith("firstfix_sightings_total{")
        )

    def headers(self, key: str) -> dict[str, str]:
        return {"Authorization": f"Bearer {self.keys[key]}"}


@contextmanager
def running_console(
    folder: Path,
    host: str,
    versions: tuple[BuildResult, BuildResult],
    scans: list[tuple[Scan, Matrix]],
) -> Iterator[ConsoleWorld]:
    """Runs the service with real query workers and real builds."""
    issuer = folder / "issuer.json"
    issuer.write_text(json.dumps(ALL_KEYS))
    with running_service(
        folder,
        load=None,
        zenoh=False,
        workers=1,
        run_builds=True,
        build_sandbox="off",
        auth="on",
        keys_refresh_s=0.1,
        jwt_jwks=str(issuer),
        jwt_issuer=ISSUER,
        jwt_audience=AUDIENCE,
        recorded_share=1.0,
        recorded_share_localized=1.0,
        recorded_per_minute=6000,
    ) as service:
        keys = ApiKeys(service.catalog.store)
        given = {
            "admin": keys.create("the operator", Grant.parse(("admin",), ("*",)))[1],
            "reader": keys.create("a robot", Grant.parse(("localize",), ("*",)))[1],
            "stranger": keys.create("a stranger", Grant.parse(("admin",), ("nothing-*",)))[1],
            "token": signed(sub=MARKUP, scope="admin", exp=time.time() + 86400),
        }
        digests = tuple(service.catalog.publish("yard", one.directory, one.manifest) for one in versions)
        served = service.part(MapParts).maps.served
        wait_until(lambda: served.version("yard") == digests[-1])  # or the first query is for the coarse one
        files = []
        for number, (scan, T_map_sensor) in enumerate(scans):
            file = folder / f"scan-{number:02}.ffscan"
            file.write_bytes(encode_scan(scan))
            files.append((file, T_map_sensor))
        port = service.url.rpartition(":")[2]
        yield ConsoleWorld(service, f"http://{host}:{port}", given, files, (digests[0], digests[1]))


def scans_without_cabin(yard: SmallWorld, templates_m: NDArray[np.floating]) -> list[Scan]:
    """Scans from all over the yard, after its cabin (the last box of the mesh) was taken away."""
    left = Simulator(yard.vertices, yard.triangles[:-BOX_TRIANGLES])
    clean = PerturbConfig(occluders=0, strangers=0, unmapped=0, vanished=0)
    sensor = SensorModel.from_mapping(SENSOR)
    scans = perturbed_scans(left, sensor, templates_m, 1.0, 24, clean, np.random.default_rng(5))
    return [scan for scan, _ in scans]


def house() -> SmallWorld:
    """Two storeys of 5 x 4 m with things in them, and a roof."""
    rng = np.random.default_rng(3)
    roof: Box = ((0.0, 0.0, 2 * STOREY_M), (5.4, 4.4, 0.2))
    storeys = [part for floor in (0.0, STOREY_M) for part in (_shell(floor), _things(floor, rng))]
    return mesh_of([roof, *(box for part in storeys for box in part)])


def room() -> dict[str, SmallWorld]:
    """One storey of such a house, in two files by name."""
    return {"shell.ply": mesh_of(_shell(0.0)), "things.ply": mesh_of(_things(0.0, np.random.default_rng(3)))}


def _shell(floor: float) -> list[Box]:
    walls = ((0, 2, 5, 0.2), (0, -2, 5, 0.2), (2.5, 0, 0.2, 4), (-2.5, 0, 0.2, 4))
    return [
        ((0.0, 0.0, floor - 0.1), (5.4, 4.4, 0.2)),
        *(((x, y, floor + 1.4), (w, d, 2.8)) for x, y, w, d in walls),
    ]


def _things(floor: float, rng: np.random.Generator) -> list[Box]:
    boxes: list[Box] = []
    for _ in range(5):
        w, d, h = rng.uniform(0.3, 1.2, 3)
        boxes.append(((*rng.uniform([-2.0, -1.5], [2.0, 1.5]), floor + h / 2), (w, d, h)))
    return boxes
