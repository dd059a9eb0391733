"""Provenance of a version: what it was made of, by whom and how, and what came of it in a few numbers.

It is recorded with the publication, in the map's log, and not in the manifest: the manifest names the
version, and the same map and config give the same version whoever builds it. The first publication counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from ..errors import InvalidOption
from ..telemetry.redact import redact
from .manifest import Manifest

MAX_CHARS = 300  # of a text; the command may have MAX_COMMAND_CHARS
MAX_NOTE_CHARS = 500
MAX_COMMAND_CHARS = 1000
_LIMITS = {"note": MAX_NOTE_CHARS, "command": MAX_COMMAND_CHARS}
PRIVATE = ("caller", "host", "command")  # who and where: for admins, and for the caller itself


@dataclass(frozen=True)
class Provenance:
    """Provenance of a version: its source and its maker. A text is empty where it is not known.

    Attributes:
        file_name: of the source, without its folder.
        size_bytes: of the source; 0: not known.
        sha256: of the source's file; empty for a folder.
        trajectory: file name of the poses of the mapping run.
        note: whatever its maker wrote.
        release: of firstfix, which built it.
        caller: who asked for the build: ``key:<id>``, ``jwt:<subject>``, ``address:<address>`` or
            ``user:<name>``.
        host: machine that built it.
        command: command line or request.
    """

    file_name: str = ""
    size_bytes: int = 0
    sha256: str = ""
    trajectory: str = ""
    note: str = ""
    release: str = ""
    caller: str = ""
    host: str = ""
    command: str = ""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, str):
                object.__setattr__(self, field.name, _plain(value, _LIMITS.get(field.name, MAX_CHARS)))

    def to_mapping(self, *, private: bool = True) -> dict[str, Any]:
        """JSON-ready form.

        Args:
            private: with who made it, and where.
        """
        return {name: value for name, value in asdict(self).items() if private or name not in PRIVATE}

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Provenance:
        """Read what ``to_mapping`` wrote. What is missing or of another type is left out."""
        kinds = {field.name: int if field.name == "size_bytes" else str for field in fields(cls)}
        return cls(**{name: values[name] for name, kind in kinds.items() if type(values.get(name)) is kind})


def check_note(note: Any) -> str:
    """A note that a version may have.

    Raises:
        InvalidOption: it is no text, or too long.
    """
    if not isinstance(note, str) or len(note) > MAX_NOTE_CHARS:
        raise InvalidOption(f"a note is a text of at most {MAX_NOTE_CHARS} characters")
    return note


def summary_of(manifest: Manifest) -> dict[str, Any]:
    """Numbers by which versions are told apart in a list.

    Returns:
        ``sensor``, ``size_m`` (x, y, z; None: not known), ``templates``, the shares ``found`` and
        ``localized`` of the self-test and its number of ``false_accepts`` (None: there was none), and
        ``threshold``: ``min_probability``, ``max_false_accept``, ``bound`` and ``kept_by``, or None.
    """
    tested, size_m = manifest.self_test, None
    if len(manifest.bounds) == 2:
        size_m = [round(high - low, 1) for low, high in zip(*manifest.bounds, strict=True)]
    threshold = tested.get("threshold")
    if threshold is not None:
        numbers = ("min_probability", "max_false_accept", "bound", "kept_by")
        threshold = {name: threshold[name] for name in numbers if name in threshold}
    return {
        "sensor": str(manifest.sensor.get("name", ""))[:MAX_CHARS],
        "size_m": size_m,
        "templates": manifest.counts.get("templates"),
        "found": tested.get("found"),
        "localized": tested.get("localized"),
        "false_accepts": tested.get("false_accepts"),
        "threshold": threshold,
    }


def _plain(text: str, most: int) -> str:
    """One line without control characters and secrets."""
    return redact("".join(c if c.isprintable() else " " for c in text[: 2 * most])).strip()[:most]


UNKNOWN = Provenance()  # of a version whose publication did not record it
