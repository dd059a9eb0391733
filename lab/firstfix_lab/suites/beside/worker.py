"""A process that answers queries with a checkout's code."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from types import TracebackType
from typing import Any

from ...checkout import ROOT
from ...common.load import Body
from .tree import Tree


class CannotLoad(Exception):
    """The checkout's code cannot read the version."""


class Worker:
    """One process with one map."""

    def __init__(self, tree: Tree, version: Path) -> None:
        self._process = subprocess.Popen(
            tree.command("serve"),
            cwd=ROOT,
            env=tree.environment(),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        loaded = self.call("load", version=str(version))
        if "error" in loaded:
            self.close()
            raise CannotLoad(loaded["error"])
        self.templates: int = loaded["templates"]

    def __enter__(self) -> Worker:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the process."""
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            pipe.close()
        self._process.wait()

    def ask(self, body: Body) -> dict[str, Any]:
        """The answer to a query, and its processor milliseconds."""
        return self.call("ask", body)

    def call(self, do: str, body: Body | None = None, **arguments: Any) -> dict[str, Any]:
        """Send a request and return the reply.

        Raises:
            RuntimeError: the process ended.
        """
        request = {"do": do, **arguments}
        if body is not None:
            request |= {"media_type": body.media_type, "bytes": len(body.content)}
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(request).encode() + b"\n")
        if body is not None:
            self._process.stdin.write(body.content)
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(
                f"the process ended with status {self._process.wait()}: its messages are above"
            )
        return json.loads(line)
