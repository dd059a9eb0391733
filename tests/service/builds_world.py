"""Builds by the fake build process, over HTTP."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import httpx

from firstfix.builds.records import FINAL_STATES
from tests.service.service_world import FAKE_WORKER, Service, running_service
from tests.waiting import wait_until

CLOUD = b"0 0 0\n1 1 1\n"


def building_service(directory: Path, **changes: Any):
    values = {"run_builds": True, "build_command": FAKE_WORKER, "zenoh": False, **changes}
    return running_service(directory, **values)


def upload(service: Service, map_id: str = "hall", do: str = "succeed", **config: Any) -> httpx.Response:
    """Submits a map. Its sensor name tells the fake build process what to do."""
    config = {"sensor": {"preset": "vlp-16", "name": do}, **config}
    return service.http.post(
        "/maps",
        data={"map_id": map_id, "config": json.dumps(config)},
        files={"source": ("../hall map.xyz", CLOUD), "trajectory": ("track.txt", b"0 0 0 0 0 0 0 1")},
    )


def status_of(service: Service, response: httpx.Response) -> dict[str, Any]:
    answer = service.http.get(response.headers["location"])
    assert answer.status_code == 200
    return dict(answer.json())


def wait_until_ended(service: Service, response: httpx.Response) -> dict[str, Any]:
    wait_until(lambda: status_of(service, response)["state"] in FINAL_STATES)
    return status_of(service, response)


def is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def order(work: Path) -> list[str]:
    """Maps of the builds that the fake build process ran in a work folder, in order."""
    path = work / "order.txt"
    return [line.split()[0] for line in path.read_text().splitlines()] if path.exists() else []
