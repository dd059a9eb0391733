"""One scan in several encodings: what is asked, and what is told of the answers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from firstfix.answer.localization import Verdict
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import AnyScan
from firstfix_lab.suites.encodings.forms import (
    FORMS,
    Answer,
    Differences,
    Pair,
    differences_of,
    pairs_of,
    told,
)
from firstfix_lab.suites.real.degrade import within

LOCALIZED, AMBIGUOUS = Verdict.LOCALIZED, Verdict.AMBIGUOUS


@dataclass
class Listener:
    """Stands in for a localizer: the share of a scan's points that are not where they were is its doubt."""

    whole: Scan

    def localize(self, scan: AnyScan) -> Answer:
        assert not isinstance(scan, tuple)
        points = np.asarray(scan.points)  # type: ignore[union-attr]
        if len(points) != len(self.whole):
            return Answer(AMBIGUOUS, 0.5)
        return Answer(LOCALIZED, 1.0 - float(np.abs(points - self.whole.points).max()))


@pytest.fixture
def scan() -> Scan:
    rng = np.random.default_rng(3)
    at = rng.normal(size=(3000, 3))
    return Scan.from_points(at / np.linalg.norm(at, axis=1, keepdims=True) * rng.uniform(2, 20, (3000, 1)))


def test_each_form_is_asked_as_a_service_decodes_it(scan: Scan):
    pairs = {pair.form: pair for pair in pairs_of(Listener(scan), scan)}  # type: ignore[arg-type]
    assert list(pairs) == list(FORMS)
    assert all(pair.whole == Answer(LOCALIZED, 1.0) for pair in pairs.values())
    assert 0 < pairs["whole millimetres"].difference <= 0.0006
    assert 0.001 < pairs["scan, 1 cm"].difference <= 0.006
    assert not pairs["compact"].is_same_verdict


def test_differences_count_where_the_verdict_is_the_same():
    one = Answer(AMBIGUOUS, 0.5)
    others = [Answer(AMBIGUOUS, 0.5 + away) for away in (0.0, 0.01, -0.3)] + [Answer(LOCALIZED, 1.0)]
    found = differences_of([Pair("compact", one, other) for other in others])
    of_all = found["compact"]["all"]
    assert (of_all.same, of_all.other_verdict, of_all.over) == (3, 1, 1)
    assert (of_all.median, of_all.most) == (pytest.approx(0.01), pytest.approx(0.3))
    assert of_all.median < of_all.p95 < of_all.most
    assert found["compact"]["ambiguous"] == of_all
    assert math.isnan(found["compact"]["localized"].most)
    assert "| compact | ambiguous | 3 | 0.0100 | " in told(found)
    assert Differences.of([]).same == 0


def test_a_scan_is_cut_to_what_lies_near(scan: Scan):
    near = within(scan, 8.0)
    assert 0 < len(near) < len(scan)
    assert np.linalg.norm(near.points, axis=1).max() <= 8.0
    assert len(within(scan, np.inf)) == len(scan)
