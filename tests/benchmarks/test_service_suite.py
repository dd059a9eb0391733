"""The service suite, small: what HTTP adds to a query."""

import numpy as np
import pytest

from benchmarks.service import request_path
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


def test_the_request_path_is_told_by_process(
    small_version, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    asked = [
        "--version",
        str(small_version.directory),
        "--rounds",
        "1",
        "--queries",
        "2",
        "--body",
        "compact",
    ]
    monkeypatch.setattr("sys.argv", ["request_path", *asked])
    request_path.main()
    names, *rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [row[:2] for row in rows] == [["http", "compact"], ["zenoh", "compact"]]
    for role in ("server", "workers"):
        assert all(float(row[names.index(f"{role}_cpu_ms")]) > 0 for row in rows)
