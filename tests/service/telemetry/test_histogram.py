"""Histograms of the service against those of ``prometheus_client``: equal samples, and equal exposition."""

from __future__ import annotations

import re
import threading

import numpy as np
import prometheus_client
import pytest
from prometheus_client import CollectorRegistry
from prometheus_client.exposition import generate_latest
from prometheus_client.openmetrics.exposition import generate_latest as openmetrics

from firstfix_service.telemetry.histogram import Histogram

BUCKETS = (0.001, 0.25, 1.0, 10.0)


def _both(
    labels: tuple[str, ...],
) -> tuple[CollectorRegistry, Histogram, CollectorRegistry, prometheus_client.Histogram]:
    ours, theirs = CollectorRegistry(), CollectorRegistry()
    return (
        ours,
        Histogram("a_seconds", "Time", labels, buckets=BUCKETS, registry=ours),
        theirs,
        prometheus_client.Histogram("a_seconds", "Time", labels, buckets=BUCKETS, registry=theirs),
    )


def _text(exposition: bytes) -> str:
    """Without the times at which series and exemplars were made."""
    text = re.sub(r"(_created\S*) \S+", r"\1 <time>", exposition.decode())
    return re.sub(r"(# \{[^}]*\} \S+) \S+", r"\1 <time>", text)


@pytest.mark.parametrize("labels", [(), ("stage",), ("stage", "kind")])
def test_the_exposition_is_that_of_prometheus_client(labels: tuple[str, ...]):
    ours, own, theirs, other = _both(labels)
    rng = np.random.default_rng(1)
    for number in range(300):
        amount = float(rng.choice([0.0, *BUCKETS, rng.exponential(1), rng.exponential(30)]))
        if not labels:
            own.observe(amount)
            other.observe(amount)
            continue
        values = [f"{label}{number % 3}" for label in labels]
        exemplar = {"trace_id": f"{number:032x}"} if number % 7 == 0 else None
        own.labels(*values).observe(amount, exemplar)
        other.labels(*values).observe(amount, exemplar)
    assert _text(generate_latest(ours)) == _text(generate_latest(theirs))
    assert _text(openmetrics(ours)) == _text(openmetrics(theirs))


def test_a_histogram_without_observations_is_shown_as_theirs_is():
    for labels in ((), ("stage",)):
        ours, _, theirs, _ = _both(labels)
        assert _text(generate_latest(ours)) == _text(generate_latest(theirs)), labels


def test_wrong_labels_and_a_second_metric_of_the_name_are_refused():
    ours, own, *_ = _both(("stage",))
    with pytest.raises(ValueError, match="a_seconds has the labels stage"):
        own.labels("a", "b")
    with pytest.raises(ValueError, match="Duplicated"):
        prometheus_client.Histogram("a_seconds", "Time", registry=ours)


def test_no_observation_of_several_threads_is_lost():
    ours, own, *_ = _both(("stage",))

    def observe() -> None:
        for _ in range(5000):
            own.labels("search").observe(0.5)

    threads = [threading.Thread(target=observe) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert ours.get_sample_value("a_seconds_count", {"stage": "search"}) == 20_000
    assert ours.get_sample_value("a_seconds_sum", {"stage": "search"}) == 10_000
