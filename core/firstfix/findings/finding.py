"""A finding: what is wrong or noteworthy with an input, in words and numbers, with its remedy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any


class Severity(str, Enum):
    """Weight of a finding."""

    ERROR = "error"  # the input cannot work as it is
    WARNING = "warning"  # it works, or may work, but something is not as it should be
    INFO = "info"  # worth knowing


@dataclass(frozen=True)
class Finding:
    """Fault of a scan or a map, or something noteworthy about it.

    Attributes:
        code: stable name, which programs compare.
        severity: weight.
        text: what was found, in one English sentence with its numbers.
        numbers: what was measured, by name with unit.
        remedy: what helps, in one English sentence.
        doc: path of the documents' page that tells more, from the repository's root.
        places: some points (x, y, z) of a map where it shows, in the coordinates of the map's file.
    """

    code: str
    severity: Severity
    text: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    remedy: str = ""
    doc: str = ""
    places: tuple[tuple[float, float, float], ...] = ()

    def at(self, places: tuple[tuple[float, float, float], ...]) -> Finding:
        """The same, with the places where it shows."""
        return replace(self, places=places)

    def to_mapping(self) -> dict[str, Any]:
        """Values ready for JSON."""
        places = {"places": [list(one) for one in self.places]} if self.places else {}
        return {
            "code": self.code,
            "severity": self.severity.value,
            "text": self.text,
            "numbers": dict(self.numbers),
            "remedy": self.remedy,
            "doc": self.doc,
            **places,
        }

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any]) -> Finding:
        """Read what ``to_mapping`` returned. Unknown keys are ignored."""
        return cls(
            str(data["code"]),
            Severity(data["severity"]),
            str(data["text"]),
            {str(name): float(value) for name, value in data.get("numbers", {}).items()},
            str(data.get("remedy", "")),
            str(data.get("doc", "")),
            tuple((float(x), float(y), float(z)) for x, y, z in data.get("places", ())),
        )
