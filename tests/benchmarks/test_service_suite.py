"""The service suite, small: what HTTP adds to a query."""

import numpy as np
import pytest

from benchmarks.service.queried_version import QueriedVersion
from benchmarks.service.suite import measure

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def queried(small_version, small_scans) -> QueriedVersion:
    templates = len(np.load(small_version.directory / "template_position_m.npy", mmap_mode="r"))
    return QueriedVersion("yard", small_version.directory, templates, [scan for scan, _ in small_scans[:4]])


def test_what_http_adds_is_told(queried: QueriedVersion):
    figures = measure(queried, ["overhead"], quick=True)
    assert figures["templates"] > 100
    added = figures["overhead"]
    for figure in ("over_http_ms", "bare_localizer_ms", "added_ms", "added_less_decoding_ms"):
        assert np.isfinite(added[figure]), figure
