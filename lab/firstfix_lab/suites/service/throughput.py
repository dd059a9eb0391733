"""Answers per second and their latency, by transport, encoding and number of clients.

Also the time that HTTP adds to the localizer's own time.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from http.client import HTTPConnection
from typing import Any, Literal
from urllib.parse import urlsplit

import numpy as np

from firstfix.scan.scan import Scan
from firstfix_client.steps.scan_body import BodyForm, Encoding, encoded

from ...common.load import Ask, Body, ask_over_http, ask_over_zenoh, asked_for
from .queried_version import QueriedVersion

ENCODINGS: tuple[Encoding | Literal["raw"], ...] = ("raw", "scan", "compact", "descriptor")


def body_of(queried: QueriedVersion, scan: Scan, encoding: Encoding | Literal["raw"] = "scan") -> Body:
    if encoding == "raw":
        return Body("application/vnd.firstfix.xyz", scan.points.tobytes())
    return Body(*encoded(scan, BodyForm(encoding, queried.parameters())))


def throughput(
    url: str, endpoint: str, map_id: str, queried: QueriedVersion, clients: tuple[int, ...], seconds: float
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
            bodies = [body_of(queried, scan, encoding) for scan in queried.scans]
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


def overhead(url: str, map_id: str, queried: QueriedVersion, passes: int = 3) -> dict[str, float]:
    """Milliseconds that HTTP adds: medians of the same scans in this process and over HTTP, in turn.

    The client is the standard library's, so that the figure is the service's. What is left of a round trip
    beside the localizer's own stages is told with and without reading the scan's encoding.
    """
    localizer, bodies = queried.localizer(), [body_of(queried, scan) for scan in queried.scans]
    bare, around, added, added_undecoded = [], [], [], []
    with closing(HTTPConnection(urlsplit(url).netloc, timeout=30)) as http:
        for turn in range(passes + 1):  # the first loads what is loaded late
            for scan in queried.scans:
                begin = time.perf_counter()
                localizer.localize(scan)
                if turn:
                    bare.append((time.perf_counter() - begin) * 1e3)
            for body in bodies:
                begin = time.perf_counter()
                http.request(
                    "POST", f"/localize?map={map_id}", body.content, {"Content-Type": body.media_type}
                )
                response = http.getresponse()
                answer = response.read()
                took_ms = (time.perf_counter() - begin) * 1e3
                assert response.status == 200, answer
                stages = json.loads(answer)["timings_ms"]
                own = sum(ms for name, ms in stages.items() if name not in ("queue", "map", "decode"))
                if turn:
                    around.append(took_ms)
                    added.append(took_ms - own)
                    added_undecoded.append(took_ms - own - stages["decode"])
    medians = {
        "bare_localizer_ms": bare,
        "over_http_ms": around,
        "added_ms": added,
        "added_less_decoding_ms": added_undecoded,
    }
    return {name: round(float(np.median(values)), 2) for name, values in medians.items()}
