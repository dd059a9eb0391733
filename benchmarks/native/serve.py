"""Queries answered with the code on the path, for the process that started this one (``worker``).

Each request is a line of JSON, followed by the body of a query if it has one; each reply is a line of JSON.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.decode import decode_query

from .layouts import core

Query = tuple[bytes, str]  # body, media type


class Answerer:
    """A map, and the queries that are asked of it again and again."""

    def __init__(self) -> None:
        self._localizer: Any = None
        self._kept: list[Query] = []

    def load(self, request: dict[str, Any], body: bytes) -> dict[str, Any]:
        """Loads a version. One that this code cannot read is an answer, too."""
        try:
            index = core("MapIndex").load(Path(request["version"]))
        except Exception as error:  # of whatever checkout: each has its own errors
            return {"error": f"{type(error).__name__}: {str(error).splitlines()[0]}"}
        self._localizer = core("Localizer")(index)
        return {"templates": len(index.cascade.templates.position_m)}

    def ask(self, request: dict[str, Any], body: bytes) -> dict[str, Any]:
        """Answers a query, from its body to the pose."""
        begin = time.process_time()
        answer = self._answer((body, request["media_type"]))
        cpu_ms = 1e3 * (time.process_time() - begin)
        pose = answer.T_map_sensor
        return {
            "cpu_ms": cpu_ms,
            "verdict": answer.verdict.value,
            "reasons": [reason.value for reason in answer.reasons],
            "T_map_sensor": None if pose is None else np.asarray(pose).tolist(),
            "probability": float(answer.probability),
        }

    def keep(self, request: dict[str, Any], body: bytes) -> dict[str, Any]:
        """Keeps a query for ``switches`` and ``repeat``."""
        self._kept.append((body, request["media_type"]))
        return {}

    def switches(self, request: dict[str, Any], body: bytes) -> dict[str, Any]:
        """Answers the kept queries in each of several threads, and counts how often a thread had to wait."""
        with ThreadPoolExecutor(request["threads"]) as threads:
            list(threads.map(self._answer, self._kept[: request["threads"]]))  # now all threads have begun
            before = resource.getrusage(resource.RUSAGE_SELF)
            runs = [threads.submit(self._answer_kept) for _ in range(request["threads"])]
            for run in runs:
                run.result()
            after = resource.getrusage(resource.RUSAGE_SELF)
        return {
            "fixes": request["threads"] * len(self._kept),
            "voluntary": after.ru_nvcsw - before.ru_nvcsw,
        }

    def repeat(self, request: dict[str, Any], body: bytes) -> dict[str, Any]:
        """Answers the kept queries one after the other, for a time."""
        begin, cpu, fixes = time.perf_counter(), time.process_time(), 0
        while time.perf_counter() - begin < request["seconds"]:
            self._answer(self._kept[fixes % len(self._kept)])
            fixes += 1
        return {
            "fixes_a_second": fixes / (time.perf_counter() - begin),
            "cpu_ms": 1e3 * (time.process_time() - cpu) / fixes,
        }

    def _answer_kept(self) -> None:
        for query in self._kept:
            self._answer(query)

    def _answer(self, query: Query) -> Any:
        return self._localizer.localize(decode_query(*query))


def main() -> None:
    """Answers requests until there are no more."""
    replies = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what a library prints is no reply
    answerer = Answerer()
    while line := sys.stdin.buffer.readline():
        request = json.loads(line)
        body = sys.stdin.buffer.read(request.get("bytes", 0))
        reply = getattr(answerer, request["do"])(request, body)
        print(json.dumps(reply), file=replies, flush=True)


if __name__ == "__main__":
    main()
