"""The encodings suite on the small world."""

import pytest

from benchmarks.encodings.forms import COMPACT, DESCRIPTOR, FORMS, QUICK, RAW
from benchmarks.encodings.suite import measure, report
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer


@pytest.fixture(scope="module")
def rows(small_version, small_scans):
    return measure(Localizer(MapIndex.load(small_version.directory)), small_scans[:6], QUICK)


def test_every_form_has_its_row(rows):
    assert list(rows) == [form.name for form in QUICK]
    assert all(row["n"] == 6 for row in rows.values())
    assert rows[RAW.name]["log_odds_shift"] == 0


def test_a_compact_query_is_as_good_and_small(rows):
    raw, compact = rows[RAW.name], rows[COMPACT.name]
    assert compact["success_0.2m"] >= raw["success_0.2m"] - 1 / 6 - 1e-9
    assert compact["bytes"]["max"] < 10_000 < raw["bytes"]["p50"]


def test_a_descriptor_is_never_localized(rows):
    row = rows[DESCRIPTOR.name]
    assert row["verdicts"] == {"localized": 0, "ambiguous": 6, "rejected": 0}
    assert row["among_10"] >= 0.8
    assert row["bytes"]["max"] < 1500


def test_the_report_names_every_form(rows):
    text = report({"machine": {"cpus": 2}, "yard": rows, "street": "skipped: not here"})
    assert "### yard" in text
    assert all(form.name in text for form in QUICK)
    assert len({form.name for form in FORMS}) == len(FORMS)
