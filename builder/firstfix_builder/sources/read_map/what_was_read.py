"""Record of a reading: the format, the unit, the clouds and poses that were used, and what was left out."""

from __future__ import annotations

from dataclasses import dataclass, replace

MAX_TEXT = 200


def plain(text: str) -> str:
    """A text of a file in one line of printable characters, cut where it is long."""
    return "".join(one for one in " ".join(text.split()) if one.isprintable())[:MAX_TEXT]


@dataclass(frozen=True)
class LeftOut:
    """Parts of a source that are not in the map.

    Attributes:
        what: in the plural, such as "points"; or one thing by its name, such as "tile a.pcd".
        reason: in words, as "marked as withheld".
        count: how many.
    """

    what: str
    reason: str
    count: int = 1

    @property
    def words(self) -> str:
        """One line for people."""
        named = f"{self.count:,} {self.what}" if self.what.endswith("s") else self.what
        return f"left out: {named} ({self.reason})"


@dataclass(frozen=True)
class WhatWasRead:
    """Facts about a source. An empty string says that nothing is known.

    Attributes:
        form: format of the file, or layout of the folder, as "LAS 1.4" or "KISS-SLAM's folder".
        program: that wrote it, where the file says so.
        unit: of the coordinates, as the file says, as "US survey foot".
        georeference: coordinate system, as the file says.
        clouds: names of the files or scans whose points are in the map.
        poses: where the trajectory comes from: the name of a file, or of what brings it.
        left_out: what is not in the map.
        notes: other sentences for people.
    """

    form: str = ""
    program: str = ""
    unit: str = ""
    georeference: str = ""
    clouds: tuple[str, ...] = ()
    poses: str = ""
    left_out: tuple[LeftOut, ...] = ()
    notes: tuple[str, ...] = ()

    def without(self, *left_out: LeftOut) -> WhatWasRead:
        """The same with more that was left out; what is left out for one reason is counted together."""
        counts: dict[tuple[str, str], int] = {}
        for one in (*self.left_out, *left_out):
            counts[one.what, one.reason] = counts.get((one.what, one.reason), 0) + one.count
        counted = (LeftOut(what, reason, count) for (what, reason), count in counts.items() if count)
        return replace(self, left_out=tuple(counted))
