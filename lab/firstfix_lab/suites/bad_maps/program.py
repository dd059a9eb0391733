"""``firstfix-lab bad_maps``: what the check finds in good and bad maps, and what builds hold back.

The check takes some 100 s of a processor for all, and making the maps half as long. ``--build`` builds
them, a minute or three each; with words, those alone that have all of them in their names.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from ...common.markdown import table
from .cases import GOOD, cases
from .judge import PASSED, WARNED, Judged, by_build, by_check
from .places import is_available


def main(argv: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(prog="firstfix-lab bad_maps", description=__doc__)
    parser.add_argument("words", nargs="*", help="of the names of the maps; none: all maps")
    parser.add_argument("--build", action="store_true", help="build them, test them and ask the gate")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here, case by case")
    given = parser.parse_args(argv)
    rows = []
    for one in _judged(given.words, is_built=given.build):
        rows.append(_row(one))
        print(" | ".join(map(str, rows[-1].values())), flush=True)
        if given.json:
            given.json.write_text(json.dumps(rows, indent=1) + "\n")
    print("", *table(tuple(rows[0]), [tuple(row.values()) for row in rows]), sep="\n")
    wrong = [row["map"] for row in rows if not row["as it should be"]]
    print(f"\n{len(rows)} maps, {len(wrong)} not as they should be", *wrong, sep="\n  ")


def _judged(words: list[str], *, is_built: bool) -> Iterator[Judged]:
    there = [
        case for case in cases() if is_available(case.place) and all(word in case.name for word in words)
    ]
    if not is_built:
        yield from (by_check(case) for case in there if not case.is_seen_by_builds)
        return
    for case in there:
        with tempfile.TemporaryDirectory() as folder:
            yield by_build(case, Path(folder) / "build")


def _row(one: Judged) -> dict[str, object]:
    return {
        "map": one.case.name,
        "outcome": one.outcome,
        "findings": ", ".join(one.codes),
        "found": one.found,
        "localized": one.localized,
        "processor s": round(one.cpu_s, 1),
        "why": one.why,
        "s per million points": round(one.cpu_s / one.points * 1e6, 1),
        "as it should be": is_right(one),
    }


def is_right(one: Judged) -> bool:
    """Whether a bad map did not pass and its fault is named, and nothing was found in a good one.

    Of a good one that is built, it is right if its build is activated.
    """
    if one.case.fault != GOOD:
        return one.outcome != PASSED and (not one.case.code or one.case.code in one.codes)
    return one.outcome == PASSED or (one.found is not None and one.outcome == WARNED)
