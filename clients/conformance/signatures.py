"""Vectors of signed zenoh queries, and of replies to them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from firstfix.wire.signature import Asked, SigningKey

Vector = dict[str, Any]

API_KEY = "ffx_0123456789ab_" + "0f1e2d3c4b5a6978" * 4
SCAN = "application/vnd.firstfix.scan"
_NONCE = bytes(range(16)).hex()
_TIME_MS = 1_767_225_600_123
_USUAL = [["deadline_ms", "9000"], ["gravity", "0.1,0.0,-9.8"]]
_QUERIES: dict[str, tuple[str, list[list[str]], str, bytes]] = {
    "usual": ("firstfix/hall/localize/r1", _USUAL, SCAN, b"a scan"),
    "shared-key": ("firstfix/hall/localize", _USUAL, SCAN, b"a scan"),
    "nothing": ("firstfix/@any/localize", [], "", b""),
    "wildcard": ("firstfix/*/localize/**", [["map", ""]], "zenoh/bytes", b"\0"),
    "strange": (
        "firstfix/höhle/localize",
        [
            ["é", "1"],
            ["z", "\U0001f916"],
            ["", "no name"],
            ["a", "="],
            ["_anyke", ""],
            ["a", ""],
            ["\uffff", ""],
        ],
        "application/cdr;sensor_msgs/msg/PointCloud2",
        bytes(range(256)),
    ),
}


def vectors() -> Iterator[Vector]:
    for name, (key, parameters, encoding, payload) in _QUERIES.items():
        given = {"key": key, "parameters": parameters, "encoding": encoding, "payload": payload.hex()}
        yield {
            "name": f"zenoh-query-{name}",
            "function": "zenoh_query",
            "input": {"api_key": API_KEY, **given, "time_ms": _TIME_MS, "nonce": _NONCE},
        }
    signer = SigningKey.of_api_key(API_KEY)
    other = SigningKey.of_api_key(API_KEY[:-1] + "0")
    assert signer is not None
    assert other is not None
    query = signer.sign(Asked.of("firstfix/hall/localize", [], SCAN), b"a scan", _TIME_MS, bytes(16))
    later = signer.sign(Asked.of("firstfix/hall/localize", [], SCAN), b"a scan", _TIME_MS, bytes(15) + b"\1")
    skew = json.dumps({"code": "clock_skew", "status": 401, "time_ms": _TIME_MS}).encode()
    answer, problem = b'{"verdict": "rejected"}', "application/problem+json"
    right = signer.signed_encoding(query, True, "application/json", answer)
    for name, is_ok, encoding, payload in (
        ("answer", True, right, answer),
        ("pose", True, signer.signed_encoding(query, True, "application/vnd.ros2.cdr", b"\0\1"), b"\0\1"),
        ("without-encoding", True, signer.signed_encoding(query, True, "", b""), b""),
        ("error", False, signer.signed_encoding(query, False, problem, skew), skew),
        ("of-another-kind", False, right, answer),
        ("of-another-content", True, right, answer + b" "),
        ("of-another-encoding", True, right.replace("json", "jsom"), answer),
        ("of-another-query", True, signer.signed_encoding(later, True, "application/json", answer), answer),
        ("of-another-key", True, other.signed_encoding(query, True, "application/json", answer), answer),
        ("unsigned", True, "application/json", answer),
        ("in-capitals", True, right[:-64] + right[-64:].upper(), answer),
        ("cut", True, right[:-1], answer),
    ):
        yield {
            "name": f"zenoh-reply-{name}",
            "function": "zenoh_reply",
            "input": {
                "api_key": API_KEY,
                "attachment": query.to_bytes().hex(),
                "is_ok": is_ok,
                "encoding": encoding,
                "payload": payload.hex(),
            },
        }
