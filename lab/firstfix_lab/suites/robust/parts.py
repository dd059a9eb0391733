"""A world's part of the suite on disk: its outcomes so far, and what they were measured with."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
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
        outcomes: of ``cases``, in their order.
        templates: sensor to number of templates.
        conditions: of the run: another run with the same ones has the same outcomes.
        cases: names of those that were measured.
        seconds: that it took, builds included.
    """

    world: str
    outcomes: tuple[Outcome, ...] = ()
    templates: Mapping[str, int] = field(default_factory=dict)
    conditions: Mapping[str, Any] = field(default_factory=dict)
    cases: tuple[str, ...] = ()
    seconds: float = 0.0

    @property
    def is_whole(self) -> bool:
        """Whether all cases of the run were measured."""
        return list(self.cases) == self.conditions["cases"]

    def with_case(
        self, case: str, outcomes: Sequence[Outcome], templates: Mapping[str, int], seconds: float
    ) -> Part:
        """The part with one more case."""
        return replace(
            self,
            outcomes=(*self.outcomes, *outcomes),
            templates={**self.templates, **templates},
            cases=(*self.cases, case),
            seconds=self.seconds + seconds,
        )

    def save(self, folder: Path) -> None:
        """Write ``WORLD/outcomes.csv`` and then ``WORLD/part.json`` below the folder.

        Whoever is killed meanwhile leaves the part as it was before.
        """
        own = folder / self.world
        own.mkdir(parents=True, exist_ok=True)
        write_outcomes(own / "new.csv", self.outcomes)
        (own / "new.csv").replace(own / "outcomes.csv")
        names = ("templates", "conditions", "cases", "seconds")
        about = {name: getattr(self, name) for name in names}
        (own / "new.json").write_text(json.dumps(about, indent=1) + "\n")
        (own / "new.json").replace(own / "part.json")

    @classmethod
    def load(cls, folder: Path, world: str) -> Part | None:
        """The world's part; None: there is none."""
        about = folder / world / "part.json"
        if not about.exists():
            return None
        kept = json.loads(about.read_text())
        cases = tuple(kept.pop("cases"))
        rows = read_outcomes(folder / world / "outcomes.csv")  # perhaps with those of a case that is not told
        return cls(world, tuple(row for row in rows if row.case in cases), cases=cases, **kept)


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
