"""Stores with thousands of maps, made in seconds: versions of their own, of files that are links to one."""

from __future__ import annotations

import json
import os
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime, timezone
from hashlib import sha256
from pathlib import Path

from firstfix.catalog.log.map_state import Event, LogEntry
from firstfix.catalog.manifest import FILE_NAME, FileEntry, Manifest

MARK = "mark.txt"  # what makes a version its map's own


def name_of(number: int) -> str:
    return f"map-{number:06}"


def grow_catalog(root: Path, version: Path | None, have: int, wanted: int) -> None:
    """Add maps with one version each, numbers ``have`` to ``wanted``, to a store in a directory.

    The objects are those that ``Catalog.publish`` would write.

    Args:
        version: folder of the files that each of them has; None: nothing but a mark.
    """
    files = {} if version is None else _files(version)
    base = Manifest.for_directory(version) if version is not None else Manifest({})
    entries = {name: entry for name, entry in base.files.items() if name in files}
    now = datetime.now(timezone.utc).isoformat(timespec="seconds")
    for number in range(have, wanted):
        map_id = name_of(number)
        mark = map_id.encode()
        own = FileEntry(len(mark), sha256(mark).hexdigest())
        manifest = replace(base, files={**entries, MARK: own})
        folder = root / "maps" / map_id / "versions" / manifest.digest
        folder.mkdir(parents=True)
        for name, path in files.items():
            os.link(path, folder / name)
        (folder / MARK).write_bytes(mark)
        (folder / FILE_NAME).write_bytes(manifest.to_json())
        log = root / "maps" / map_id / "log"
        log.mkdir()
        for seq, event in enumerate((Event.PUBLISHED, Event.ACTIVATED), 1):
            entry = LogEntry(seq, event, manifest.digest, now, writer=uuid.uuid4().hex)
            (log / f"{seq:06}.json").write_bytes(entry.to_json())
        changes = root / "changes"
        changes.mkdir(exist_ok=True)
        (changes / f"{number + 1:08}.json").write_text(json.dumps({"map_id": map_id}))


def _files(version: Path) -> dict[str, Path]:
    """The files of a version that a query reads; the pictures are left out."""
    names = (path.name for path in version.iterdir() if path.suffix != ".png" and path.name != FILE_NAME)
    return {name: version / name for name in sorted(names)}


@contextmanager
def environment(values: Mapping[str, str]) -> Iterator[None]:
    """Variables of this process, and of those that it starts, for as long as the block lasts."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
