"""A world's part of the suite on disk: its outcomes, and what they were measured with."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from firstfix.answer.localization import Verdict

from .outcome import Outcome, Standing

_READ = {
    "str": str,
    "int": int,
    "float": float,
    "bool": lambda text: text == "True",
    "Verdict": Verdict,
    "Standing": Standing,
}


@dataclass(frozen=True)
class Part:
    """Outcomes of one world, with the conditions of the run.

    Attributes:
        templates: sensor to number of templates.
        conditions: of the run: another run with the same ones has the same outcomes.
        seconds: that it took, builds included.
    """

    world: str
    outcomes: tuple[Outcome, ...]
    templates: dict[str, int]
    conditions: dict[str, Any]
    seconds: float

    def save(self, folder: Path) -> None:
        """Writes ``WORLD/outcomes.csv`` and then ``WORLD/part.json`` below the folder."""
        own = folder / self.world
        own.mkdir(parents=True, exist_ok=True)
        (own / "part.json").unlink(missing_ok=True)
        write_outcomes(own / "outcomes.csv", self.outcomes)
        about = {"templates": self.templates, "conditions": self.conditions, "seconds": round(self.seconds)}
        (own / "part.json").write_text(json.dumps(about, indent=1) + "\n")

    @classmethod
    def load(cls, folder: Path, world: str) -> Part | None:
        """The world's part; None: there is none."""
        about = folder / world / "part.json"
        if not about.exists():
            return None
        outcomes = read_outcomes(folder / world / "outcomes.csv")
        return cls(world, outcomes, **json.loads(about.read_text()))


def write_outcomes(path: Path, outcomes: Sequence[Outcome]) -> None:
    """One row a query."""
    names = [f.name for f in fields(Outcome)]
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        for outcome in outcomes:
            values = (getattr(outcome, name) for name in names)
            writer.writerow([f"{v:.5g}" if isinstance(v, float) else getattr(v, "value", v) for v in values])


def read_outcomes(path: Path) -> tuple[Outcome, ...]:
    """The rows that ``write_outcomes`` wrote, floats to five digits."""
    with path.open(newline="") as file:
        return tuple(
            Outcome(**{f.name: _READ[str(f.type)](row[f.name]) for f in fields(Outcome)})
            for row in csv.DictReader(file)
        )
