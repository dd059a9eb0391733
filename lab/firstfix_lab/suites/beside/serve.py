"""Queries answered with the code on the path, for the process that started this one (``worker``).

Each request is a line of JSON, followed by the body of a query if it has one; each reply is a line of JSON.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.decode import decode_query
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer


class Answerer:
    """A map, and the queries that are asked of it."""

    def __init__(self) -> None:
        self._localizer: Localizer

    def load(self, request: dict[str, Any], body: bytes) -> dict[str, Any]:
        """Load a version. One that this code cannot read is an answer, too."""
        try:
            index = MapIndex.load(Path(request["version"]))
        except Exception as error:  # of whatever checkout: each has its own errors
            return {"error": f"{type(error).__name__}: {str(error).splitlines()[0]}"}
        self._localizer = Localizer(index)
        return {"templates": len(index.cascade.templates.position_m)}

    def ask(self, request: dict[str, Any], body: bytes) -> dict[str, Any]:
        """Answer a query, from its body to the pose."""
        begin = time.process_time()
        answer = self._localizer.localize(decode_query(body, request["media_type"]))
        cpu_ms = 1e3 * (time.process_time() - begin)
        pose = answer.T_map_sensor
        return {
            "cpu_ms": cpu_ms,
            "verdict": answer.verdict.value,
            "reasons": [reason.value for reason in answer.reasons],
            "T_map_sensor": None if pose is None else np.asarray(pose).tolist(),
            "probability": float(answer.probability),
        }


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
