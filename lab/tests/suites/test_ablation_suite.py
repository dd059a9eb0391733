"""The default method with its parts taken out, on a small world's scans."""

from __future__ import annotations

import numpy as np

from firstfix.answer.options import LocalizeOptions
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.scan import Scan
from firstfix_lab.suites.ablation.parts import PARTS, WHOLE
from firstfix_lab.suites.ablation.report import report
from firstfix_lab.suites.ablation.suite import measure


def test_each_part_is_taken_out_alone(small_version, small_scans):
    index = MapIndex.load(small_version.directory)
    found = measure("small", index, small_scans[:3])
    assert set(found) == {part.name for part in PARTS}
    assert all(figures["n"] == 3 for figures in found.values())
    assert found[WHOLE.name]["against"]["truth"]["right_first"] == 1.0
    rows = [
        line for line in report({"small": found, "far": "skipped: it is far"}).splitlines() if "|" in line
    ]
    assert len(rows) == 2 * (len(PARTS) + 2), "a table of all sets, and one of the set that was there"


def test_the_version_itself_stays_as_it_is(small_version, small_scans):
    index = MapIndex.load(small_version.directory)
    before = index.config, index.surface, index.aliases, index.seen_free
    (scan, _), options = small_scans[0], LocalizeOptions()
    whole = Localizer(index).localize(scan, options)
    for part in PARTS:
        part.localizer(index).localize(scan, part.options)
    assert (index.config, index.surface, index.aliases, index.seen_free) == before
    again = WHOLE.localizer(index).localize(scan, options)
    assert again.probability == whole.probability
    np.testing.assert_array_equal(again.hypotheses[0].T_map_sensor, whole.hypotheses[0].T_map_sensor)


def test_every_part_changes_something(small_version):
    index = MapIndex.load(small_version.directory)
    for part in PARTS:
        changed = part.localizer(index).index
        is_same = (
            changed.config == index.config
            and type(changed.surface) is type(index.surface)
            and changed.aliases is index.aliases
            and changed.seen_free is index.seen_free
            and part.options is None
        )
        has_it = part.name != "seen-free space" or index.seen_free is not None
        assert is_same == (part is WHOLE or not has_it), part.name


def test_a_hasty_alignment_is_believed(small_version, small_scans):
    (part,) = (one for one in PARTS if one.name == "alignment until it rests")
    scan: Scan = small_scans[0][0]
    answer = part.localizer(MapIndex.load(small_version.directory)).localize(scan)
    assert "not_converged" not in answer.reasons
