"""The service suite, small: what HTTP adds to a query, and what consoles cost."""

from pathlib import Path

import numpy as np
import pytest

from firstfix_lab.suites.service.consoles import STATES, ConsoleCourse, consoles
from firstfix_lab.suites.service.queried_version import QueriedVersion
from firstfix_lab.suites.service.suite import QUICK, measure
from firstfix_lab.suites.service.throughput import body_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def queried(small_version, small_scans) -> QueriedVersion:
    templates = len(np.load(small_version.directory / "template_position_m.npy", mmap_mode="r"))
    return QueriedVersion("yard", small_version.directory, templates, [scan for scan, _ in small_scans[:4]])


def test_what_http_adds_is_told(queried: QueriedVersion):
    figures = measure(queried, ["overhead"], QUICK)
    assert figures["templates"] > 100
    added = figures["overhead"]
    for figure in ("over_http_ms", "bare_localizer_ms", "added_ms", "added_less_decoding_ms"):
        assert np.isfinite(added[figure]), figure


def test_what_consoles_cost_is_told(queried: QueriedVersion, tmp_path: Path):
    bodies = [body_of(queried, scan) for scan in queried.scans]
    course = ConsoleCourse(points=60_000, templates=1000, consoles=3, clients=2, phase_s=1.0, rounds=1)
    figures = consoles(queried, bodies, tmp_path, course)
    for state in STATES:
        assert set(figures[state]["outcomes"]) == {"ok"}
    for ratios in figures["ratio_to_without"].values():
        assert all(ratio > 0 for ratio in ratios.values())
    read = figures["read_by_consoles"]
    assert read["opened"] >= 3, "every console saw the map"
    assert read["answers"] >= 3
    assert figures["mib"]["before"] > 0
