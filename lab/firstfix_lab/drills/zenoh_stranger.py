"""A stranger on the zenoh network of a service with API keys: what he learns, and whom he deceives.

    firstfix-lab zenoh_stranger [--queries 40] [--tokens 20] [--late] [--root CHECKOUT]

Two replicas and a robot with an API key. The stranger has no key. He declares the robot's keys as complete
queryables and shows tokens of replicas that do not exist; he keeps the queries that he gets silent or open,
or answers with a false pose or a false error. Then he sends what he has recorded over HTTP and zenoh, to the
same and to other maps and replicas, and lastly he tells a robot of false versions. With ``--root``, service
and robot are those of another checkout, such as an older release.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from firstfix_lab.checkout import ROOT

MAP, OTHER_MAP, TRUE_X, FALSE_X = "hall", "yard", 1.0, 666.0
WAYS = ("alone", "silent", "false pose", "false error", "open")
LATE_S = 65.0
TIMEOUT_S = 10.0
SAID = "@said "


# Roles of the checkout that is tried: run as a script by its own Python. They use what every release has.


def serve(folder: Path, ports: list[int], auth: str) -> None:
    """Two replicas of one store; prints where they are, and changes a version for each line that it reads."""
    from firstfix.access.api_keys import ApiKeys
    from firstfix.access.permissions import Grant
    from firstfix.store.store import Store
    from tests.service.service_world import publish, running_service

    store = str(folder / "store")
    key = ApiKeys(Store.open(store)).create("robot", Grant.parse(["localize"], ["*"]))[1]
    listens = [f"tcp/0.0.0.0:{port}" for port in ports]
    first: dict[str, Any] = {"store": store, "auth": auth, "replica": "r1", "zenoh_listen": (listens[0],)}
    second = {**first, "replica": "r2", "zenoh_listen": (listens[1],)}
    second["zenoh_connect"] = (f"tcp/127.0.0.1:{ports[0]}",)
    with running_service(folder / "1", **first) as one, running_service(folder / "2", **second) as two:
        for map_id, label in ((MAP, "1"), (OTHER_MAP, "2")):
            publish(one.catalog, map_id, label, one.scratch)
        while any(f"firstfix/{OTHER_MAP}/localize/r{n}" not in tokens(one.session) for n in (1, 2)):
            time.sleep(0.05)
        say({"key": key, "urls": [one.url, two.url]})
        for number, _ in enumerate(sys.stdin):
            say({"version": publish(one.catalog, MAP, f"{1 + number}.0", one.scratch)})


def tokens(session: Any) -> set[str]:
    replies = session.liveliness().get("firstfix/*/localize/*", timeout=5)
    return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}


def drive(endpoint: str, key: str) -> None:
    """A robot: localizes once for each line that it reads, and prints x or the error."""
    import numpy as np

    from firstfix_client import ZenohClient

    with ZenohClient(endpoint, api_key=key, timeout_s=TIMEOUT_S) as client:
        for _ in sys.stdin:
            begun = time.monotonic()
            try:
                pose = client.localize(np.ones((50, 3), np.float32), map_id=MAP).T_map_sensor
                outcome: dict[str, Any] = {"x": None if pose is None else float(pose[0, 3])}
            except Exception as error:  # whatever it is, the robot has no answer
                outcome = {"error": repr(error)}
            say({**outcome, "ms": round(1000 * (time.monotonic() - begun), 1)})


def watch(endpoint: str) -> None:
    """A robot that prints every change of the map's version."""
    from firstfix_client import ZenohClient

    with ZenohClient(endpoint) as client, client.watch_versions(look_every_s=0.2) as changes:
        for change in changes:
            say({"version": change.version})


def say(line: dict[str, Any]) -> None:
    print(SAID + json.dumps(line), flush=True)


# The stranger, and the table.


class Process:
    """A role in a process of the checkout."""

    def __init__(self, root: Path, log: Path, *arguments: str) -> None:
        with log.open("ab") as errors:
            self._process = subprocess.Popen(
                [str(python_of(root)), str(Path(__file__).resolve()), *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                cwd=root,
                env={"PATH": "/usr/bin:/bin", "PYTHONPATH": str(root), "HOME": str(log.parent)},
                text=True,
            )
        self._log = log

    def next(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        for line in self._process.stdout:  # the service's log comes there, too
            if line.startswith(SAID):
                return dict(json.loads(line[len(SAID) :]))
        raise AssertionError(f"it has ended: {self._log.read_text()[-2000:]}")

    def ask(self) -> dict[str, Any]:
        assert self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return self.next()

    def end(self) -> None:
        self._process.kill()
        self._process.communicate()


def python_of(root: Path) -> Path:
    own = root / ".venv" / "bin" / "python"
    return own if own.exists() else Path(sys.executable)


@dataclass
class Stranger:
    """A session without a key.

    Attributes:
        way: what he does with the queries that he gets.
        recorded: key, parameters, encoding, payload and attachment of each.
    """

    session: Any
    way: str = "alone"
    recorded: list[tuple[str, dict[str, str], str, bytes, bytes | None]] = field(default_factory=list)
    answered: int = 0
    _held: list[Any] = field(default_factory=list)
    _declared: list[Any] = field(default_factory=list)

    def take_part(self, way: str, false_tokens: int) -> None:
        """Declare the robot's keys and false replicas, or take everything back."""
        self.way = way
        for one in (*self._declared, *self._held):
            (one.drop if hasattr(one, "drop") else one.undeclare)()
        self._declared, self._held = [], []
        if way != "alone":
            for key in ("firstfix/**", "firstfix/*/localize/**", f"firstfix/{MAP}/localize"):
                self._declared.append(self.session.declare_queryable(key, self._on_query, complete=True))
            names = [f"{number:012x}" for number in range(false_tokens)]
            for name in names:
                token = self.session.liveliness().declare_token(f"firstfix/{MAP}/localize/{name}")
                self._declared.append(token)

    def _on_query(self, query: Any) -> None:
        attachment = None if query.attachment is None else query.attachment.to_bytes()
        payload = b"" if query.payload is None else query.payload.to_bytes()
        parameters = dict(iter(query.parameters))
        self.recorded.append((str(query.key_expr), parameters, str(query.encoding), payload, attachment))
        if self.way == "open":
            self._held.append(query)
            return
        with query, contextlib.suppress(Exception):
            self.answered += self.way != "silent"
            if self.way == "false pose":
                mark = f"application/json;firstfix-v1={'0' * 64}" if self.answered % 2 else "application/json"
                query.reply(query.key_expr, false_answer(), encoding=mark)
            elif self.way == "false error":
                code = ("unauthorized", "not_found", "clock_skew")[self.answered % 3]
                problem = {"code": code, "detail": "a lie", "status": 401, "time_ms": 1}
                query.reply_err(json.dumps(problem).encode(), encoding="application/problem+json")


def false_answer() -> bytes:
    import numpy as np

    from firstfix.answer.localization import Localization, Verdict

    T = np.eye(4)
    T[0, 3] = FALSE_X
    answer = Localization(Verdict.LOCALIZED, (), T, None, np.eye(6), 0.99, map_id=MAP, map_version="e" * 64)
    return json.dumps(answer.to_mapping()).encode()


def wait_until(condition: Callable[[], bool], limit_s: float = 300.0) -> None:
    end = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def wait_until_shown(looker: Any, is_shown: bool) -> None:
    """Wait for his first false token, which comes after all his keys."""
    token = f"firstfix/{MAP}/localize/{0:012x}"
    wait_until(lambda: bool(list(looker.liveliness().get(token, timeout=5))) == is_shown)


def run(root: Path, folder: Path, *, queries: int, false_tokens: int, late: bool) -> dict[str, Any]:
    """A row for each of the stranger's ways, for what he sends again, and for his notices."""
    from tests.claimed import free_port

    ports = [free_port(), free_port()]
    table: dict[str, Any] = {}
    with contextlib.ExitStack() as stack:
        service = Process(root, folder / "service.log", "serve", str(folder / "a"), *map(str, ports), "on")
        stack.callback(service.end)
        found = service.next()
        endpoint = f"tcp/127.0.0.1:{ports[0]}"
        stranger = Stranger(stack.enter_context(session_at(endpoint)))
        looker = stack.enter_context(session_at(endpoint))
        for way in WAYS:
            stranger.take_part(way, false_tokens)
            wait_until_shown(looker, way != "alone")
            had, answered = len(stranger.recorded), stranger.answered
            robot = Process(root, folder / "robot.log", "drive", endpoint, found["key"])
            stack.callback(robot.end)
            outcomes = [robot.ask() for _ in range(queries)]
            robot.end()
            table[way] = {
                "queries": queries,
                "seen by the stranger": len(stranger.recorded) - had,
                "false replies": stranger.answered - answered,
                "false answers accepted": sum(one.get("x") == FALSE_X for one in outcomes),
                "answered rightly": sum(one.get("x") == TRUE_X for one in outcomes),
                "median ms": sorted(one["ms"] for one in outcomes)[queries // 2],
                "errors": sorted({one["error"] for one in outcomes if "error" in one}),
            }
        stranger.take_part("alone", 0)
        if late:
            time.sleep(LATE_S)
        table["sent again"] = send_again(stranger, found, min(queries, 12))
    table["false versions"] = tell_lies(root, folder)
    return table


def send_again(stranger: Stranger, found: dict[str, Any], most: int) -> dict[str, Any]:
    """Send recorded queries, and what they carried, elsewhere. Returns how many were answered."""
    import httpx

    of_map = [one for one in stranger.recorded if f"/{MAP}/" in one[0]]
    named = [one for one in of_map if one[0].endswith(("/r1", "/r2"))]
    sample = [*named[-most:], *[one for one in of_map if one[0].endswith("/localize")][-most:]]
    works: dict[str, int] = {}
    for key, parameters, encoding, payload, attachment in sample:
        text = (attachment or b"").decode("latin-1")
        for url in found["urls"]:
            header = {"Authorization": b"Bearer " + (attachment or b""), "Content-Type": encoding}
            with contextlib.suppress(httpx.HTTPError, ValueError):
                answer = httpx.post(f"{url}/localize?map={MAP}", content=payload, headers=header)
                works["HTTP"] = works.get("HTTP", 0) + (answer.status_code == 200)
        other = key.replace("/r1", "/r0").replace("/r2", "/r1").replace("/r0", "/r2")
        for name, there, body in (
            ("the same again", key, payload),
            ("another map", key.replace(MAP, OTHER_MAP), payload),
            ("another replica", other, payload),
            ("another payload", key, payload[:-1]),
        ):
            if name == "another replica" and other == key:
                continue
            replies = stranger.session.get(
                selector(there, parameters),
                payload=body,
                encoding=encoding,
                attachment=attachment,
                timeout=10,
            )
            works[name] = works.get(name, 0) + any(reply.ok is not None for reply in replies)
        works["bare keys seen"] = works.get("bare keys seen", 0) + text.startswith("ffx_")
    return {"sent": len(sample), **works}


def selector(key: str, parameters: dict[str, str]) -> Any:
    import zenoh

    return zenoh.Selector(key, parameters)


def tell_lies(root: Path, folder: Path, lies: int = 3) -> dict[str, Any]:
    """Tell a watching robot of false versions; returns how many true changes it still reports."""
    from tests.claimed import free_port

    ports = [free_port(), free_port()]
    endpoint = f"tcp/127.0.0.1:{ports[0]}"
    service = Process(root, folder / "service.log", "serve", str(folder / "b"), *map(str, ports), "off")
    watching = Process(root, folder / "watch.log", "watch", endpoint)
    heard: list[str | None] = []
    try:
        service.next()
        watching.end()
        watching = Process(root, folder / "watch.log", "watch", endpoint)

        def listen() -> None:
            with contextlib.suppress(AssertionError):
                while True:
                    heard.append(watching.next()["version"])

        threading.Thread(target=listen, daemon=True).start()
        true = 0
        with session_at(endpoint) as session:
            for number in range(lies):
                lie = {"map_id": MAP, "seq": 10**15 + number, "version": "e" * 64}
                nonsense = '{"map_id": "hall", "seq": 1e999, "version": null}'
                for text in (json.dumps(lie), nonsense, "[" * 2000):
                    session.put(f"firstfix/{MAP}/version", text)
                made = service.ask()["version"]
                end = time.monotonic() + 30.0
                while made not in heard and time.monotonic() < end:
                    time.sleep(0.05)
                true += made in heard
    finally:
        watching.end()
        service.end()
    return {"lies": lies, "true changes": lies, "reported": true}


@contextlib.contextmanager
def session_at(endpoint: str) -> Iterator[Any]:
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        yield session


def harm_in(table: dict[str, Any], queries: int) -> list[str]:
    """Harm that a stranger must not be able to do, and did."""
    harm = [f"{way}: a false answer was accepted" for way in WAYS if table[way]["false answers accepted"]]
    harm += [f"{way}: answers lacked" for way in WAYS if table[way]["answered rightly"] < queries]
    again = table["sent again"]
    harm += [f"{name} worked" for name in again if name != "sent" and again[name]]
    versions = table["false versions"]
    return harm + (["changes went unheard"] if versions["reported"] < versions["true changes"] else [])


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="firstfix-lab zenoh_stranger",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("--queries", type=int, default=40)
    parser.add_argument("--tokens", type=int, default=20)
    parser.add_argument("--late", action="store_true", help="wait over a minute before the recorded is sent")
    parser.add_argument("--root", type=Path, default=ROOT)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        table = run(
            given.root.resolve(),
            Path(folder),
            queries=given.queries,
            false_tokens=given.tokens,
            late=given.late,
        )
    for name, row in table.items():
        print(f"{name}:", ", ".join(f"{what} {value}" for what, value in row.items()))
    if given.json is not None:
        given.json.write_text(json.dumps(table, indent=1) + "\n")
    harm = harm_in(table, given.queries)
    print("harm:", "; ".join(harm) or "none")
    return int(bool(harm))


if __name__ == "__main__":
    role, *rest = sys.argv[1:]
    if role == "serve":
        serve(Path(rest[0]), [int(rest[1]), int(rest[2])], rest[3])
    elif role == "drive":
        drive(rest[0], rest[1])
    else:
        watch(rest[0])
