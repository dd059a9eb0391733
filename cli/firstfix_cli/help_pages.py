"""The remedy after an error about a map, a scan or a service: one line, and the page that tells more."""

from __future__ import annotations

from collections.abc import Mapping

from firstfix.errors import (
    BuildFailed,
    BuildTimedOut,
    CorruptVersion,
    FirstfixError,
    IncompatibleVersion,
    MalformedData,
    NothingToPatch,
    TooLarge,
    UnfitMap,
    UnsupportedFormat,
)
from firstfix_client.errors import ServiceUnreachable

_FILES = "docs/how-to/my-map.md"
_HELP: dict[type[FirstfixError], tuple[str, str]] = {
    UnfitMap: ("Look at the map with: firstfix check MAP", "docs/how-to/my-map.md"),
    MalformedData: ("Open the file in CloudCompare, and save it again as PLY, PCD or LAZ.", _FILES),
    UnsupportedFormat: (
        "Maps are PCD, PLY, LAS, LAZ, E57, text, NumPy or mesh files, or SLAM folders.",
        _FILES,
    ),
    TooLarge: ("Thin the map to one point in 0.1 m, or split it.", "lab/docs/large-maps.md"),
    BuildFailed: ("Look at the map with: firstfix check MAP", "docs/how-to/my-map.md"),
    NothingToPatch: (
        "See what is seen, and by how many: firstfix maps changes MAP",
        "docs/how-to/my-map.md",
    ),
    BuildTimedOut: ("Thin the map, or raise FIRSTFIX_BUILD_TIMEOUT_S.", "lab/docs/large-maps.md"),
    CorruptVersion: ("Build the version again: firstfix maps rebuild MAP", "docs/how-to/operate.md"),
    IncompatibleVersion: ("Build the version again: firstfix maps rebuild MAP", "docs/how-to/operate.md"),
}
_SCANS = "docs/how-to/my-scan-is-not-localized.md"
_SCAN_HELP: dict[type[FirstfixError], tuple[str, str]] = {
    MalformedData: ("Write the scan again, as PCD, PLY or .npy.", _SCANS),
    UnsupportedFormat: (
        "Scans are PCD, PLY, LAS, LAZ, NumPy, text, KITTI's .bin or a bag.",
        "docs/how-to/bags.md#what-can-be-read",
    ),
    TooLarge: ("A scan is one turn of the sensor: a map, or many turns, is none.", _SCANS),
}
_NO_SERVICE = (
    "Start one: firstfix serve --store STORE; or name another by --url or --zenoh, or a store by --store "
    "(see docs/quickstart.md)"
)
OF_MAPS = ("build", "check", "maps")  # commands whose files are maps


def help_line(error: Exception, command: str) -> str | None:
    """A line after the error of a command; None for errors that say all themselves."""
    if isinstance(error, ServiceUnreachable):
        return _NO_SERVICE
    return _line(error, _HELP) if command in OF_MAPS else None


def scan_help_line(error: Exception) -> str | None:
    """A line after the error of a scan's file; None for errors that say all themselves."""
    return _line(error, _SCAN_HELP)


def _line(error: Exception, helps: Mapping[type[FirstfixError], tuple[str, str]]) -> str | None:
    found = next((helps[cls] for cls in type(error).__mro__ if cls in helps), None)
    return None if found is None else f"{found[0]} (see {found[1]})"
