"""The forms in which one scan is asked, and what their answers have in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from firstfix.answer.localization import Verdict
from firstfix.decode import decode_query
from firstfix.engine.localizer import Localizer
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import AnyScan
from firstfix_client.steps.scan_body import BodyForm, encoded

FORMS = {
    "whole millimetres": BodyForm(resolution_m=0.001),
    "scan, 1 cm": BodyForm(resolution_m=0.01),
    "range image, 2.5 cm": BodyForm("range_image"),
    "compact": BodyForm("compact"),
}
WITHIN = 0.02  # what one number may differ by


@dataclass(frozen=True)
class Answer:
    """Verdict and probability of one scan in one form."""

    verdict: Verdict
    probability: float


@dataclass(frozen=True)
class Pair:
    """The answers to a scan's points as they are, and to the same scan in another form."""

    form: str
    whole: Answer
    other: Answer

    @property
    def is_same_verdict(self) -> bool:
        return self.whole.verdict is self.other.verdict

    @property
    def difference(self) -> float:
        """Of the probabilities, without a sign."""
        return abs(self.whole.probability - self.other.probability)


def pairs_of(localizer: Localizer, scan: Scan) -> list[Pair]:
    """Ask the scan as it is, then in each of ``FORMS`` as a service decodes it."""
    whole = _asked(localizer, scan)
    found = []
    for name, form in FORMS.items():
        media_type, body = encoded(scan, form)
        found.append(Pair(name, whole, _asked(localizer, decode_query(body, media_type))))
    return found


def _asked(localizer: Localizer, scan: AnyScan) -> Answer:
    answer = localizer.localize(scan)
    return Answer(answer.verdict, answer.probability)


@dataclass(frozen=True)
class Differences:
    """How far a form's probabilities are from those of the points, where the verdict is the same.

    Attributes:
        same: scans with the same verdict.
        other_verdict: scans with another one.
        median, p95, most: of the differences; NaN: there is none.
        over: how many differ by more than WITHIN.
    """

    same: int
    other_verdict: int
    median: float
    p95: float
    most: float
    over: int

    @classmethod
    def of(cls, pairs: Sequence[Pair]) -> Differences:
        apart = np.array([one.difference for one in pairs if one.is_same_verdict])
        median, p95, most = np.quantile(apart, (0.5, 0.95, 1.0)).tolist() if len(apart) else (np.nan,) * 3
        return cls(len(apart), len(pairs) - len(apart), median, p95, most, int((apart > WITHIN).sum()))


def differences_of(pairs: Sequence[Pair]) -> dict[str, dict[str, Differences]]:
    """Differences by form, and by the verdict to the points: all of them, and each for itself."""
    found: dict[str, dict[str, Differences]] = {}
    for form in FORMS:
        of_form = [one for one in pairs if one.form == form]
        found[form] = {"all": Differences.of(of_form)}
        for verdict in Verdict:
            found[form][verdict.value] = Differences.of(
                [one for one in of_form if one.whole.verdict is verdict]
            )
    return found


def told(found: dict[str, dict[str, Differences]]) -> str:
    """A Markdown table: a row for each form and verdict."""
    lines = [
        f"| form | verdict | scans | median | 95 % | most | over {WITHIN} | another verdict |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for form, by_verdict in found.items():
        for verdict, one in by_verdict.items():
            figures = " | ".join(f"{figure:.4f}" for figure in (one.median, one.p95, one.most))
            lines.append(
                f"| {form} | {verdict} | {one.same} | {figures} | {one.over} | {one.other_verdict} |"
            )
    return "\n".join(lines)
