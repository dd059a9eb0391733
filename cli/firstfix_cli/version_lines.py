"""Maps and versions as lines of a table, and what a version was made of."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

SHORT = 12  # characters of a version in a table


def map_lines(maps: Iterable[Mapping[str, Any]]) -> list[str]:
    """A table of maps, with a header."""
    rows = [("MAP", "VERSION", "PUBLISHED", "SIZE (m)", "SENSOR", "LOCALIZED")]
    for entry in maps:
        numbers = entry.get("summary") or {}
        rows.append(
            (
                entry["map_id"],
                (entry["active_version"] or "none active")[:SHORT],
                minute_of(entry.get("published_time")),
                _size(numbers.get("size_m")),
                numbers.get("sensor") or "-",
                _share(numbers.get("localized")),
            )
        )
    return table(rows)


def version_lines(versions: Iterable[Mapping[str, Any]]) -> list[str]:
    """A table of a map's versions, with a header. The whole digest is in ``--json``."""
    rows = [("", "VERSION", "PUBLISHED", "FILE", "SENSOR", "LOCALIZED", "FROM", "BY", "NOTE")]
    for entry in versions:
        numbers, made = entry.get("summary") or {}, entry.get("provenance") or {}
        threshold = numbers.get("threshold") or {}
        rows.append(
            (
                "*" if entry["active"] else "",
                entry["version"][:SHORT],
                minute_of(entry.get("published_time")),
                made.get("file_name") or "-",
                numbers.get("sensor") or "-",
                "provisional" if entry.get("provisional") else _share(numbers.get("localized")),
                f"{threshold['min_probability']:g}" if "min_probability" in threshold else "-",
                made.get("caller") or "-",
                made.get("note") or "",
            )
        )
    return table(rows)


def provenance_lines(version: Mapping[str, Any]) -> list[str]:
    """Provenance of a version: its source, time and maker, as far as they are known."""
    made = version.get("provenance") or {}
    lines = []
    if made.get("file_name"):
        size = f", {made['size_bytes']:,} bytes" if made.get("size_bytes") else ""
        digest = f", sha256 {made['sha256'][:SHORT]}" if made.get("sha256") else ""
        poses = f", trajectory {made['trajectory']}" if made.get("trajectory") else ""
        lines.append(f"made of {made['file_name']}{size}{digest}{poses}")
    who = [
        f"by {made['caller']}" if made.get("caller") else "",
        f"on {made['host']}" if made.get("host") else "",
    ]
    when = f"published {minute_of(version.get('published_time'))}" if version.get("published_time") else ""
    release = f"with firstfix {made['release']}" if made.get("release") else ""
    if told := " ".join(part for part in (when, *who, release) if part):
        lines.append(told)
    if made.get("command"):
        lines.append(f"$ {made['command']}")
    if made.get("note"):
        lines.append(f"note: {made['note']}")
    return lines


def table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows as lines, each column as wide as its longest text."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return [
        "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]


def minute_of(time: str | None) -> str:
    """A time to the minute, as UTC; ``-``: it is not known."""
    return "-" if not time else time[:16].replace("T", " ")


def counted(count: int, thing: str) -> str:
    """A number of things in words."""
    return f"{count:,} {thing}" + ("" if count == 1 else "s")


def _size(size_m: Sequence[float] | None) -> str:
    return "-" if not size_m else " x ".join(f"{edge:.1f}" for edge in size_m)


def _share(share: float | None) -> str:
    return "-" if share is None else f"{share:.0%}"
