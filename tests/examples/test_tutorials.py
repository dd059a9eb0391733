"""What the tutorials show as printed: each line has the form that is printed, and their figures agree.

The figures themselves come from one build of the sample world, which takes minutes: no test makes it.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.answer.quality import AlignmentQuality
from firstfix.catalog.catalog import Catalog
from firstfix.findings.scan_kinds import SEVERAL_PLACES
from firstfix.store.store import Store
from firstfix.transform import make_transform, rotation_z
from firstfix_cli.commands.localize import lines_of
from firstfix_cli.main import run

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
    # what keeps the promise depends on the map
    line = line.replace("each answer by itself; ", "").replace("many maps show", "the self-test shows")
    return re.sub(r"-?\d[\d,.]*", "#", line).replace("#%", "#").replace("factory", "MAP")


def answers() -> list[str]:
    fit = AlignmentQuality(0.9, 0.8, 0.01)
    places = (Hypothesis(POSE, fit, 0.2, 1), Hypothesis(POSE, fit, 0.2, 2))
    shared = {"map_id": "factory", "map_version": "a" * 64}
    fix = Localization(
        Verdict.LOCALIZED, (), POSE, POSE, np.eye(6) * 1e-6, 0.97, places[:1], timings_ms={"s": 1.0}, **shared
    )
    ambiguous = Localization(
        Verdict.AMBIGUOUS,
        (Reason.SEVERAL_PLACES,),
        probability=0.2,
        hypotheses=places,
        findings=(SEVERAL_PLACES.found({"places": 2}),),
        **shared,
    )
    return [*lines_of(fix), *lines_of(ambiguous)]


def test_the_commands_print_such_lines(
    small_version, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    catalog = Catalog(Store.open(str(tmp_path / "store")))
    catalog.publish("factory", small_version.directory, small_version.manifest)
    with pytest.raises(SystemExit):
        run(["maps", "show", "factory", "--store", str(tmp_path / "store")])
    said = {form_of(line) for line in [*capsys.readouterr().out.splitlines(), *answers()]}
    shown = {line for page in TUTORIALS for line in printed_in(page)}
    assert len(shown) > 12
    assert not {line for line in shown if form_of(line) not in said and "made for a" not in line}


def test_the_figures_agree():
    page = TUTORIALS["my-map"]
    (version,) = set(re.findall(r"active ([0-9a-f]{64})", page))
    assert set(re.findall(r"version ([0-9a-f]{12})\b", page)) == {version[:12]}
    localized = re.search(r"(\d+)% answered localized", page)
    assert localized is not None
    assert f"{localized[1]} % localized" in page, "what is told of it"
    shown = re.findall(r"sensor  x (\S+)  y (\S+)", TUTORIALS["ambiguous"])
    assert shown == re.findall(r"maybe   x (\S+)  y (\S+)", TUTORIALS["ambiguous"])[:1], "the true place"
