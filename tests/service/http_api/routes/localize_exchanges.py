"""What callers of ``/localize`` sent, byte for byte, and what each got: the answer, log lines and metrics.

    python -m tests.service.http_api.routes.localize_exchanges

records it anew. A difference from what was recorded before is a change for callers.
"""

from __future__ import annotations

import gzip
import json
import re
import socket
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any
from unittest.mock import patch

import zstandard

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.catalog.geopose import MEDIA_TYPE as GEOPOSE
from firstfix.errors import CorruptVersion, InvalidScan, StoreUnavailable
from firstfix.ros.media_types import POSE
from firstfix_service.startup.retry import RetryingStart
from tests.service.access_world import KEYED, known
from tests.service.json_log import JsonLog, json_log
from tests.service.raw_connection import connect
from tests.service.service_world import SCAN_BODY, XYZ, Behaviour, Service, publish, served
from tests.waiting import wait_until

RECORDED = Path(__file__).with_name("localize_exchanges.json")
MAX_BODY_BYTES = 200_000
TRACEPARENT = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01"
PLACE = {"latitude_deg": 48.2649, "longitude_deg": 11.6713, "height_m": 529.4, "x_axis_deg": 30.0}
LONG_BODY = SCAN_BODY * 100  # received right into its place
_NOT_FOR_LINES = {"timestamp", "ms"}
_COUNTERS = re.compile(r"firstfix_(http|local|reasons|probab|stage)\w*(_total|_count)")
_numbers = count()


@dataclass(frozen=True)
class Exchange:
    """One request as bytes, or several on one connection.

    Attributes:
        is_chunked: the body comes in chunks.
        declares: Content-Length, if it is not that of the body.
        is_cut: the caller sends no more after this.
        again: number of equal requests, sent at once.
        raises: by the engine, for this query.
    """

    name: str
    method: str = "POST"
    target: str = "/localize?map=hall"
    headers: tuple[str, ...] = ()
    body: bytes = SCAN_BODY
    media_type: str | None = XYZ
    version: str = "1.1"
    is_chunked: bool = False
    declares: int | None = None
    is_cut: bool = False
    again: int = 1
    raises: Exception | None = None

    def request(self, request_id: str) -> bytes:
        """The bytes that the caller sends."""
        lines = [f"{self.method} {self.target} HTTP/{self.version}", "Host: x"]
        if not any(line.lower().startswith("x-request-id") for line in self.headers):
            lines.append(f"X-Request-Id: {request_id}")
        if self.media_type is not None:
            lines.append(f"Content-Type: {self.media_type}")
        lines += self.headers
        body = self.body
        if self.is_chunked:
            lines.append("Transfer-Encoding: chunked")
            pieces = [body[begin : begin + 500] for begin in range(0, len(body), 500)]
            body = b"".join(b"%x\r\n%b\r\n" % (len(piece), piece) for piece in [*pieces, b""])
        elif body or self.declares is not None:
            lines.append(f"Content-Length: {self.declares or len(body)}")
        return ("\r\n".join([*lines, "", ""]).encode("latin-1") + body) * self.again


@dataclass
class Caller:
    """Asks one service, and keeps what came back."""

    service: Service
    log: JsonLog
    secrets: dict[str, str] = field(default_factory=dict)

    def exchange(self, one: Exchange) -> dict[str, Any]:
        """What one exchange gave."""
        request_id = f"x{next(_numbers)}"
        self.service.behaviour.raises = one.raises
        before, lines = self._metrics(), len(self.log.lines)
        with connect(self.service) as connection:
            connection.sendall(one.request(request_id))
            if one.is_cut:
                connection.shutdown(socket.SHUT_WR)
            answer = _answers(connection, one)
        wait_until(lambda: len(self._requests(lines)) >= self._expected(answer, one))
        found = {
            "answer": self._plain(answer, request_id),
            "log": [self._plain_line(line, request_id) for line in self.log.lines[lines:] if _is_of(line)],
            "metrics": _difference(before, self._metrics()),
        }
        self.service.behaviour.raises = None
        return found

    def _requests(self, since: int) -> list[dict[str, Any]]:
        return [line for line in self.log.lines[since:] if line["event"] == "request"]

    def _expected(self, answer: bytes, one: Exchange) -> int:
        """The log lines that will come: none of what the server refuses before the app."""
        return answer.count(b"x-request-id: ") or int(one.is_cut)

    def _metrics(self) -> dict[str, float]:
        found = {}
        for family in self.service.app.state.metrics.registry.collect():
            for sample in family.samples:
                if _COUNTERS.fullmatch(sample.name):
                    found[f"{sample.name} {json.dumps(sample.labels, sort_keys=True)}"] = sample.value
        return found

    def _plain(self, answer: bytes, request_id: str) -> str:
        """The answer without what differs from one run to the next. Lengths were right."""
        text = answer.decode("latin-1").replace(request_id, "<id>")
        text = re.sub(r"\r\ndate: [^\r]*", "\r\ndate: <date>", text)
        text = re.sub(r"retry-after: \d{3,}", "retry-after: <s>", text)
        text = re.sub(r"x-request-id: [0-9a-f]{32}\r", "x-request-id: <made>\r", text)
        parts = re.split(r"(?=HTTP/1\.1 )", text)
        return "".join(self._without_times(part) for part in parts)

    def _without_times(self, part: str) -> str:
        head, _, body = part.partition("\r\n\r\n")
        length = re.search(r"content-length: (\d+)", head)
        plain = re.sub(r'"timings_ms":\{[^}]*\}', _times, body)
        plain = re.sub(r"try again in [0-9.e+-]+ s", "try again in <s> s", plain)
        if length and plain != body:
            assert int(length[1]) == len(body), "the length is that of the body"
            head = head.replace(length[0], "content-length: <right>")
        return re.sub(r"dur=[0-9.]+", "dur=<ms>", head) + ("\r\n\r\n" + plain if part else "")

    def _plain_line(self, line: dict[str, Any], request_id: str) -> dict[str, Any]:
        kept = {name: value for name, value in line.items() if name not in _NOT_FOR_LINES}
        if "exception" in kept:
            kept["exception"] = kept["exception"].splitlines()[-1]
        text = json.dumps(kept).replace(request_id, "<id>")
        text = re.sub(r'"[0-9a-f]{32}"', '"<made>"', text)
        for secret, name in self.secrets.items():
            text = text.replace(secret, name)
        found: dict[str, Any] = json.loads(text)
        return found


def _answers(connection: socket.socket, one: Exchange) -> bytes:
    """What the service sends: as many whole answers as there were requests, or all until it closes."""
    found = b""
    while piece := _received(connection):
        found += piece
        rest, whole = found, 0
        while (end := rest.find(b"\r\n\r\n")) >= 0:
            head, rest = rest[:end], rest[end + 4 :]
            length = re.search(rb"content-length: (\d+)", head)
            size = 0 if length is None or one.method == "HEAD" else int(length[1])
            if len(rest) < size:
                break
            rest = rest[size:]
            whole += not head.startswith(b"HTTP/1.1 100")
        if whole == one.again:
            break
    return found


def _received(connection: socket.socket) -> bytes:
    try:
        return connection.recv(1 << 16)
    except ConnectionError:  # it was closed while we were still sending
        return b""


def _is_of(line: dict[str, Any]) -> bool:
    return line["event"] in ("request", "unexpected error", "refused a credential")


def _times(found: re.Match[str]) -> str:
    return re.sub(r":[0-9.e-]+", ":<ms>", found[0])


def _difference(before: dict[str, float], after: dict[str, float]) -> dict[str, float]:
    changes = {name: after[name] - before.get(name, 0.0) for name in after}
    return {name: change for name, change in sorted(changes.items()) if change}


OPEN = (
    Exchange("plain"),
    Exchange("a long body", body=LONG_BODY),
    Exchange("an own request id", headers=("X-Request-Id: own-1",)),
    Exchange("a bad request id", headers=("X-Request-Id: a b{}",)),
    Exchange("a trace", headers=(f"traceparent: {TRACEPARENT}", "tracestate: a=b")),
    Exchange("a bad trace", headers=("traceparent: 00-xyz-1-01",)),
    Exchange("HTTP/1.0", version="1.0"),
    Exchange("HTTP/1.0, kept alive", version="1.0", headers=("Connection: keep-alive",)),
    Exchange("close", headers=("Connection: close",)),
    Exchange("three pipelined", again=3),
    Exchange("two pipelined that are long", again=2, body=LONG_BODY),
    Exchange("chunked", is_chunked=True),
    Exchange("chunked and empty", is_chunked=True, body=b""),
    Exchange("chunked, over the limit", is_chunked=True, body=bytes(MAX_BODY_BYTES + 12_000)),
    Exchange("over the limit", body=bytes(MAX_BODY_BYTES + 12)),
    Exchange("no body", body=b""),
    Exchange("no body, length 0", body=b"", declares=0),
    Exchange("a body that is cut off", declares=5000, is_cut=True),
    Exchange("a long body that is cut off", body=LONG_BODY, declares=150_000, is_cut=True),
    Exchange("a length that is none", headers=("Content-Length: many",), body=b""),
    Exchange("a part of a row", body=SCAN_BODY[:-1]),
    Exchange("100 Continue", headers=("Expect: 100-continue",)),
    Exchange("an upgrade", headers=("Connection: upgrade", "Upgrade: websocket")),
    Exchange("no media type", media_type=None),
    Exchange("an unknown media type", media_type="text/plain"),
    Exchange("a general media type", media_type="application/octet-stream"),
    Exchange("a bad media type", media_type="\xff;;=,"),
    Exchange("two media types", headers=("Content-Type: text/plain",)),
    Exchange("a media type with columns", media_type='application/vnd.firstfix.xyzi; columns="x,y,z"'),
    Exchange("a media type with bad columns", media_type="application/vnd.firstfix.xyzi; columns=x,y"),
    Exchange("gzip", headers=("Content-Encoding: gzip",), body=gzip.compress(SCAN_BODY, mtime=0)),
    Exchange("zstd", headers=("Content-Encoding: zstd",), body=zstandard.compress(SCAN_BODY)),
    Exchange("identity", headers=("Content-Encoding: identity",)),
    Exchange("no gzip", headers=("Content-Encoding: gzip",)),
    Exchange("an unknown encoding", headers=("Content-Encoding: br",)),
    Exchange("accepts all", headers=("Accept: */*",)),
    Exchange("accepts JSON", headers=("Accept: application/json",)),
    Exchange("accepts text", headers=("Accept: text/html",)),
    Exchange("accepts in two headers", headers=("Accept: text/html", "Accept: */*")),
    Exchange("a pose", headers=(f"Accept: {POSE}",), target="/localize?map=hall&frame=odom&stamp=1.5"),
    Exchange("a pose with a bad stamp", headers=(f"Accept: {POSE}",), target="/localize?map=hall&stamp=x"),
    Exchange("a frame for JSON", target="/localize?map=hall&frame=odom"),
    Exchange("no place on the Earth", headers=(f"Accept: {GEOPOSE}",)),
    Exchange("a place on the Earth", headers=(f"Accept: {GEOPOSE}",), target="/localize?map=yard"),
    Exchange("an unknown map", target="/localize?map=attic"),
    Exchange("a bad map", target="/localize?map=a/b"),
    Exchange("a map that is no text", target="/localize?map=%ff"),
    Exchange("a doubled map", target="/localize?map=hall&map=hall"),
    Exchange("an unknown option", target="/localize?map=hall&speed=fast"),
    Exchange("an empty option", target="/localize?map=hall&prior="),
    Exchange("an option without a value", target="/localize?map=hall&prior"),
    Exchange("a bad prior", target="/localize?map=hall&prior=1,2"),
    Exchange("a prior with blanks", target="/localize?map=hall&prior=1,+2,%203,4"),
    Exchange("a prior for two maps", target="/localize?map=hall,yard&prior=1,2,3,4"),
    Exchange("semicolons", target="/localize?map=hall;prior=1,2,3,4"),
    Exchange("empty parts", target="/localize?&map=hall&&"),
    Exchange("a bad version", target="/localize?map=hall&version=x"),
    Exchange("an unknown version", target="/localize?map=hall&version=0000000000"),
    Exchange("a bad deadline", target="/localize?map=hall&deadline_ms=-1"),
    Exchange("a deadline", target="/localize?map=hall&deadline_ms=600000"),
    Exchange("GET", method="GET", body=b"", media_type=None),
    Exchange("HEAD", method="HEAD", body=b"", media_type=None),
    Exchange("OPTIONS", method="OPTIONS", body=b"", media_type=None),
    Exchange(
        "a browser's question",
        method="OPTIONS",
        body=b"",
        media_type=None,
        headers=(
            "Origin: https://elsewhere.example",
            "Access-Control-Request-Method: POST",
            "Access-Control-Request-Headers: content-type",
        ),
    ),
    Exchange("a browser", headers=("Origin: https://elsewhere.example", "Sec-Fetch-Mode: cors")),
    Exchange("PUT", method="PUT"),
    Exchange("DELETE", method="DELETE"),
    Exchange("an unusual method", method="PROPFIND"),
    Exchange("no method", method="BREW"),
    Exchange("a slash too much", target="/localize/?map=hall"),
    Exchange("two slashes", target="//localize?map=hall"),
    Exchange("a capital", target="/Localize?map=hall"),
    Exchange("an escaped path", target="/%6Cocalize?map=hall"),
    Exchange("an escaped slash", target="/localize%2F?map=hall"),
    Exchange("a whole URL", target="http://x/localize?map=hall"),
    Exchange("a fragment", target="/localize?map=hall#prior"),
    Exchange("a credential that nobody asks for", headers=("Authorization: Bearer x",)),
    Exchange("a malformed credential that nobody asks for", headers=("Authorization: Basic eDp5",)),
    Exchange("two credentials", headers=("Authorization: Bearer x", "Authorization: Bearer y")),
    Exchange("behind a proxy", headers=("X-Forwarded-For: 203.0.113.7, 10.0.0.1",)),
    Exchange("an invalid scan", raises=InvalidScan("it has no points")),
    Exchange("a damaged version", raises=CorruptVersion("key.bin: damaged")),
    Exchange("a defect", raises=RuntimeError("odd")),
)


def record() -> dict[str, Any]:
    """All exchanges with today's code, by service and name."""
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder, json_log() as log:
        for name, exchanges in _SERVICES.items():
            found[name] = _each_once(dict(exchanges(Path(folder) / name, log)))
    return found


def _each_once(found: dict[str, Any]) -> dict[str, Any]:
    """Of outcomes that are equal, the name of the first in place of the others."""
    first: dict[str, str] = {}
    return {
        name: f"as: {first[text]}"
        if first.setdefault(text := json.dumps(outcome, sort_keys=True), name) != name
        else outcome
        for name, outcome in found.items()
    }


Found = Iterator[tuple[str, dict[str, Any]]]


@contextmanager
def _served(folder: Path, log: JsonLog, **changes: Any) -> Iterator[Caller]:
    with served(folder, zenoh=False, max_body_bytes=MAX_BODY_BYTES, **changes) as service:
        service.wait_until_loaded()
        yield Caller(service, log)


def _open(folder: Path, log: JsonLog) -> Found:
    with _served(folder, log) as caller:
        service = caller.service
        publish(service.catalog, "yard", "2", service.scratch)
        service.http.put("/maps/yard/georeference", json=PLACE).raise_for_status()
        service.wait_until_loaded(2)
        for one in OPEN:
            yield one.name, caller.exchange(one)
        service.behaviour.answers = lambda *_: Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,))
        for one in (
            Exchange("no pose"),
            Exchange("no pose on the Earth", headers=(f"Accept: {GEOPOSE}",), target="/localize?map=yard"),
            Exchange("no pose as a message", headers=(f"Accept: {POSE}",)),
        ):
            yield one.name, caller.exchange(one)


def _keyed(folder: Path, log: JsonLog) -> Found:
    with _served(folder, log, **KEYED, localize_per_s=0.001, localize_burst_s=3000) as caller:
        keys = {
            "good": known(caller.service, "localize"),
            "monitor": known(caller.service, "metrics"),
            "elsewhere": known(caller.service, "localize", maps=("yard",)),
        }
        caller.secrets = {key.split("_")[1]: name for name, key in keys.items()}

        def with_key(name: str, key: str, **more: Any) -> Exchange:
            return Exchange(name, headers=(f"Authorization: Bearer {key}",), **more)

        for one in (
            Exchange("no key"),
            Exchange("no key, no method", method="GET", body=b"", media_type=None),
            Exchange("no key, a long body", body=LONG_BODY),
            Exchange("not a bearer", headers=("Authorization: Basic eDp5",)),
            Exchange("two keys", headers=("Authorization: Bearer x", "Authorization: Bearer y")),
            Exchange("an empty key", headers=("Authorization: Bearer ",)),
            with_key("a key without form", "hunter2"),
            with_key("an unknown key", _unknown(keys["good"])),
            with_key("a wrong secret", _wrong(keys["good"])),
            with_key("a key without the scope", keys["monitor"]),
            with_key("a key of another map", keys["elsewhere"]),
            with_key("a key of another map, no map named", keys["elsewhere"], target="/localize"),
            with_key("a good key", keys["good"]),
            with_key("a good key, no map named", keys["good"], target="/localize"),
            with_key("a good key, an unknown map", keys["good"], target="/localize?map=attic"),
            with_key("over the rate", keys["good"]),
            with_key("over the rate, a long body", keys["good"], body=LONG_BODY),
        ):
            yield one.name, caller.exchange(one)


def _unknown(key: str) -> str:
    """A key that nobody has made."""
    word, key_id, secret = key.split("_")
    return "_".join((word, "".join(reversed(key_id)), secret))


def _wrong(key: str) -> str:
    """The key with another secret."""
    word, key_id, secret = key.split("_")
    return "_".join((word, key_id, "".join(reversed(secret))))


def _read_only(folder: Path, log: JsonLog) -> Found:
    with _served(folder, log) as caller:
        caller.service.app.state.settings.__dict__["read_only"] = True
        for one in (
            Exchange("a query that changes nothing"),
            Exchange("no map named", target="/localize"),
            Exchange("an empty query", target="/localize?"),
            Exchange("an empty map", target="/localize?map="),
            Exchange("the map twice", target="/localize?map=hall,hall"),
            Exchange("the map twice, escaped", target="/localize?map=hall%2Chall"),
        ):
            yield one.name, caller.exchange(one)


def _not_started(folder: Path, log: JsonLog) -> Found:
    with _served(folder, log) as caller, patch.object(RetryingStart, "parts", _nothing()):
        for one in (Exchange("not started"), Exchange("not started, no method", method="GET", body=b"")):
            yield one.name, caller.exchange(one)


def _nothing() -> property:
    def parts(self: RetryingStart) -> None:
        raise StoreUnavailable("the object store has not answered yet")

    return property(parts)


def _full(folder: Path, log: JsonLog) -> Found:
    behaviour = Behaviour()
    with _served(folder, log, behaviour=behaviour, workers=1, queue_size=0) as caller:
        behaviour.gate = threading.Event()
        late = Exchange("too late", target="/localize?map=hall&deadline_ms=150")
        yield late.name, caller.exchange(late)
        behaviour.gate.set()
        wait_until(lambda: caller.service.value("firstfix_queries_admitted") == 0)
        behaviour.gate = threading.Event()
        wait_until(lambda: behaviour.started.acquire(blocking=False))
        with connect(caller.service) as holder:
            holder.sendall(Exchange("holder").request("holder"))
            wait_until(lambda: behaviour.started.acquire(blocking=False))
            for one in (Exchange("full"), Exchange("full, a long body", body=LONG_BODY)):
                yield one.name, caller.exchange(one)
        behaviour.gate.set()


def _trusted(folder: Path, log: JsonLog) -> Found:
    with _served(folder, log, trusted_proxies=("127.0.0.0/8",)) as caller:
        for name, forwarded in (
            ("a caller", "203.0.113.7"),
            ("two", "198.51.100.1, 203.0.113.7"),
            ("bad", "x"),
        ):
            one = Exchange(f"behind a proxy: {name}", headers=(f"X-Forwarded-For: {forwarded}",))
            yield one.name, caller.exchange(one)


_SERVICES: dict[str, Callable[[Path, JsonLog], Found]] = {
    "open": _open,
    "keyed": _keyed,
    "read only": _read_only,
    "not started": _not_started,
    "full": _full,
    "trusted": _trusted,
}


if __name__ == "__main__":
    RECORDED.write_text(json.dumps(record(), indent=1) + "\n")
    sys.stdout.write(f"{RECORDED}\n")
