"""The remedy after an error about a map: one line, and the page that tells more."""

from __future__ import annotations

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
OF_MAPS = ("build", "check", "maps")  # commands whose files are maps


def help_line(error: Exception, command: str) -> str | None:
    """A line after the error of a command; None for errors that say all themselves."""
    if command not in OF_MAPS:
        return None
    found = next((_HELP[cls] for cls in type(error).__mro__ if cls in _HELP), None)
    return None if found is None else f"{found[0]} (see {found[1]})"
