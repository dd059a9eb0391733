"""Answers a second and how long each takes, by transport, encoding and number of clients; and what the
way there and back adds to the localizer's own time."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Literal

import httpx
import numpy as np

from firstfix.scan import Scan
from firstfix_client.scan_body import BodyForm, Encoding, encoded

from .load import Ask, Body, ask_over_http, ask_over_zenoh, asked_for
from .place import Place

ENCODINGS: tuple[Encoding | Literal["raw"], ...] = ("raw", "scan", "compact", "descriptor")


def body_of(place: Place, scan: Scan, encoding: Encoding | Literal["raw"] = "scan") -> Body:
    if encoding == "raw":
        return Body("application/vnd.firstfix.xyz", scan.points.tobytes())
    return Body(*encoded(scan, BodyForm(encoding, place.parameters())))


def throughput(
    url: str, endpoint: str, map_id: str, place: Place, clients: tuple[int, ...], seconds: float
) -> list[dict[str, Any]]:
    """A row for every combination.

    Args:
        endpoint: zenoh's.
    """
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    session = zenoh.open(config)
    rows = []
    try:
        transports: dict[str, Callable[[], Iterator[Ask]]] = {
            "http": partial(ask_over_http, url, map_id),
            "zenoh": partial(ask_over_zenoh, session, map_id),
        }
        for encoding in ENCODINGS:
            bodies = [body_of(place, scan, encoding) for scan in place.scans]
            size = int(np.mean([len(body.content) for body in bodies]))
            for transport, connect in transports.items():
                for number in clients:
                    found = asked_for(connect, bodies, number, seconds).figures()
                    rows.append(
                        {
                            "transport": transport,
                            "encoding": encoding,
                            "bytes": size,
                            "clients": number,
                            **found,
                        }
                    )
                    print(rows[-1], flush=True)
    finally:
        session.close()
    return rows


def overhead(url: str, map_id: str, place: Place) -> dict[str, float]:
    """What HTTP adds: the same scans asked in turn over HTTP and in this process, medians in ms.

    The answer's own stages are the service's localizer; what is left of the round trip is decoding,
    the queue, the way there and back.
    """
    localizer, bodies = place.localizer(), [body_of(place, scan) for scan in place.scans]
    bare, around, inside = [], [], []
    with httpx.Client(base_url=url, timeout=30) as http:
        for turn in range(2):  # the first loads what is loaded late
            for scan, body in zip(place.scans, bodies, strict=True):
                begin = time.perf_counter()
                localizer.localize(scan)
                middle = time.perf_counter()
                answer = http.post(
                    "/localize",
                    params={"map": map_id},
                    content=body.content,
                    headers={"Content-Type": body.media_type},
                )
                end = time.perf_counter()
                if turn:
                    stages = answer.raise_for_status().json()["timings_ms"]
                    own = sum(ms for name, ms in stages.items() if name not in ("queue", "map", "decode"))
                    bare.append((middle - begin) * 1e3)
                    around.append((end - middle) * 1e3)
                    inside.append(own)
    return {
        "bare_localizer_ms": round(float(np.median(bare)), 2),
        "over_http_ms": round(float(np.median(around)), 2),
        "over_http_less_its_localizer_ms": round(float(np.median(np.subtract(around, inside))), 2),
        "over_http_less_bare_ms": round(float(np.median(np.subtract(around, bare))), 2),
    }
