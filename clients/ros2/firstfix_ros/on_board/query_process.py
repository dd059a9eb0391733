"""Process of the local localizer: it opens a version once, then answers scans that come by its connection.

    python -m firstfix_ros.on_board.query_process DESCRIPTOR FOLDER MAP_ID

DESCRIPTOR is that of a socket. The process ends when the other end of it does.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.errors import CorruptVersion, FirstfixError, NotFound, pip_install
from firstfix.scan.scan import Scan

_SHA256 = re.compile("[0-9a-f]{64}")
Answering = Callable[[Scan, LocalizeOptions], Localization]


def opened(folder: Path, map_id: str) -> Answering:
    """The localizer of a version, whose files are as its manifest says.

    Raises:
        NotFound: there is no version in the folder.
        VersionError: it is damaged, or of another format.
        ModuleNotFoundError: the engine is not installed.
    """
    try:
        from firstfix.catalog.manifest import FILE_NAME, Manifest, verify_file
        from firstfix.engine.index import MapIndex
        from firstfix.engine.localizer import Localizer
    except ModuleNotFoundError as error:
        what = pip_install(".[service]")
        raise ModuleNotFoundError(
            f"the localizer local needs firstfix with its engine: {what} ({error})"
        ) from None
    path = folder / FILE_NAME
    if not path.is_file():
        raise NotFound(f"there is no version in the folder {folder}: it has no {FILE_NAME}")
    manifest = Manifest.from_json(path.read_bytes())
    if _SHA256.fullmatch(folder.name) and folder.name != manifest.digest:
        raise CorruptVersion(f"{FILE_NAME} is not that of the version {folder.name}")
    for name, entry in manifest.query_files.items():
        verify_file(folder / name, name, entry)
    localizer = Localizer(MapIndex.load(folder))

    def answer(scan: Scan, options: LocalizeOptions) -> Localization:
        found = localizer.localize(scan, options)
        return found.of_version(map_id, manifest.digest, provisional=manifest.provisional)

    return answer


def serve(connection: Connection, open_version: Callable[[], Answering]) -> None:
    """Answer scans until the other end closes. Errors are sent as they are."""
    try:
        answering = open_version()
    except (FirstfixError, ModuleNotFoundError) as error:
        connection.send(error)
        return
    connection.send(None)
    while True:
        try:
            scan, options = connection.recv()
        except EOFError:
            return
        try:
            result: Localization | Exception = answering(scan, options)
        except FirstfixError as error:
            result = error
        except Exception as error:  # a defect, told by the node as such
            result = RuntimeError(repr(error))
        connection.send(result)


def main() -> None:
    """Serve the caller."""
    descriptor, folder, map_id = sys.argv[1:]
    node_gone = suppress(BrokenPipeError, ConnectionResetError)
    with Connection(int(descriptor)) as connection, node_gone:
        serve(connection, lambda: opened(Path(folder), map_id))


if __name__ == "__main__":
    main()
