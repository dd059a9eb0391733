"""The service suite, small: real replicas behind a real balancer, over a store on a cable."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.service.loading import cold_load, hot_swap
from benchmarks.service.queried_version import QueriedVersion
from benchmarks.service.replicas import Course, replicas_suite
from benchmarks.service.suite import measure
from benchmarks.service.throughput import body_of

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # the suite starts and stops replicas under load


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


def test_a_version_that_was_never_seen_answers(queried: QueriedVersion, tmp_path: Path):
    assert cold_load(queried, body_of(queried, queried.scans[0]), tmp_path)["first_query_s"] > 0


def test_no_query_fails_while_versions_change(queried: QueriedVersion, tmp_path: Path):
    figures = hot_swap(
        queried,
        [body_of(queried, scan) for scan in queried.scans],
        tmp_path,
        swaps=2,
        calm_s=0.5,
        pause_s=0.1,
    )
    assert len(figures["activation_to_answer_s"]) == 2
    assert set(figures["outcomes"]) == {"ok"}


def test_no_query_fails_while_replicas_and_store_come_and_go(
    queried: QueriedVersion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.setenv(name, "")  # the suite sets them: so they are put back
    bodies = [body_of(queried, scan) for scan in queried.scans]
    figures = replicas_suite(
        queried, bodies, tmp_path, Course(replicas=2, clients=2, calm_s=0.5, cut_s=3.0, pause_s=0.1)
    )
    if "skipped" in figures:
        pytest.skip(figures["skipped"])
    for part in ("activation", "killed_and_restarted", "store_cut", "rolling_restart"):
        assert figures[part]["outcomes"]["ok"] >= 10, part
        assert figures[part]["failed"] == 0, figures[part]["outcomes"]
