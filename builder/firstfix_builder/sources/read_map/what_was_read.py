"""What a reader found in a source: the format, the unit, the clouds and poses it used, what it left out."""

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
        what: in the plural, such as "points"; of a count of 1, also the name of a file.
        reason: in words, as "marked as withheld".
        count: how many.
    """

    what: str
    reason: str
    count: int = 1

    @property
    def words(self) -> str:
        """One line for people."""
        named = self.what if self.count == 1 else f"{self.count:,} {self.what}"
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
        """The same with more that was left out; of a count of 0 nothing is said."""
        return replace(self, left_out=(*self.left_out, *(one for one in left_out if one.count)))
