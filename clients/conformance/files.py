"""Files of the vectors. ``damaged.json`` holds all damaged bodies: names and hexadecimal digits."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path

DAMAGED = "damaged.json"


def reference(name: str) -> str:
    """Returns the path of a damaged body, as vectors name it."""
    return f"{DAMAGED}#{name}"


def packed(bodies: Mapping[str, bytes]) -> bytes:
    """Returns the content of ``damaged.json``."""
    return json.dumps({name: body.hex() for name, body in bodies.items()}, indent=0).encode() + b"\n"


def read_body(folder: Path, path: str) -> bytes:
    """Reads a file, or one entry of ``damaged.json``."""
    file, _, name = path.partition("#")
    return bytes.fromhex(_damaged(folder / file)[name]) if name else (folder / file).read_bytes()


@cache
def _damaged(path: Path) -> dict[str, str]:
    bodies: dict[str, str] = json.loads(path.read_text())
    return bodies
