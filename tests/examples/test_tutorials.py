"""The printed lines of the tutorials: an answer's have their form, and the figures agree.

`make docs-outputs` prints them, from one build of the sample world, which takes minutes: no test makes it.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.answer.quality import AlignmentQuality
from firstfix.findings.scan_kinds import SEVERAL_PLACES
from firstfix.transform import make_transform, rotation_z
from firstfix_cli.commands.localize import lines_of

HOW_TO = Path(__file__).resolve().parents[2] / "docs" / "how-to"
TUTORIALS = {
    "my-map": (HOW_TO / "my-map.md").read_text().partition("\n## Is my map good?\n")[0],
    "ambiguous": (HOW_TO / "ambiguous.md").read_text(),
}
POSE = make_transform(rotation_z(-1.0), [-7.7, 1.8, 1.0])


def printed_in(page: str) -> list[str]:
    blocks = re.findall(r"^ *```text\n(.*?)^ *```", TUTORIALS[page], re.M | re.S)
    return [line.strip() for block in blocks for line in block.splitlines()]


def form_of(line: str) -> str:
    """A line without its numbers and digests."""
    line = re.sub(r"\b[0-9a-f]{12,64}\b", "#", line.strip())
    return re.sub(r"-?\d[\d,.]*", "#", line).replace("factory", "MAP")


def answers() -> list[str]:
    fit = AlignmentQuality(0.9, 0.8, 0.01)
    places = (Hypothesis(POSE, fit, 0.2, 1), Hypothesis(POSE, fit, 0.2, 2))
    shared = {"map_id": "factory", "map_version": "a" * 64}
    fix = Localization(Verdict.LOCALIZED, (), POSE, None, np.eye(6) * 1e-6, 0.97, places[:1], **shared)
    ambiguous = Localization(
        Verdict.AMBIGUOUS,
        (Reason.SEVERAL_PLACES,),
        probability=0.2,
        hypotheses=places,
        findings=(SEVERAL_PLACES.found({"places": 2}),),
        **shared,
    )
    return [*lines_of(fix), *lines_of(ambiguous)]


def test_answers_are_shown_as_they_are_printed():
    shown = {form_of(line) for page in TUTORIALS for line in printed_in(page)}
    assert {form_of(line) for line in answers()} <= shown


def test_the_figures_agree():
    page = TUTORIALS["my-map"]
    (version,) = set(re.findall(r"active ([0-9a-f]{64})", page))
    assert set(re.findall(r"version ([0-9a-f]{12})\b", page)) == {version[:12]}
    localized = re.search(r"(\d+)% answered localized", page)
    assert localized is not None
    assert f"{localized[1]} % localized" in page, "what is told of it"
    shown = re.findall(r"sensor  x (\S+)  y (\S+)", TUTORIALS["ambiguous"])
    assert shown == re.findall(r"maybe   x (\S+)  y (\S+)", TUTORIALS["ambiguous"])[:1], "the true place"
