"""Histogram of many observations: each costs a search in a list, not a lock for the sum and each bucket."""

from __future__ import annotations

import math
import os
import threading
import time
from bisect import bisect_left
from collections.abc import Iterator, Sequence

from prometheus_client import CollectorRegistry
from prometheus_client.core import HistogramMetricFamily
from prometheus_client.registry import Collector
from prometheus_client.samples import Exemplar
from prometheus_client.utils import floatToGoString

_NO_LABELS: tuple[str, ...] = ()
# As ``prometheus_client`` decides it for its own metrics.
_HAS_CREATED = os.environ.get("PROMETHEUS_DISABLE_CREATED_SERIES", "").lower() not in ("true", "1", "t")


class Series:
    """The observations of one set of label values. Thread-safe."""

    def __init__(self, bounds: Sequence[float]) -> None:
        self._bounds = bounds
        self._counts = [0.0] * len(bounds)
        self._exemplars: list[Exemplar | None] = [None] * len(bounds)
        self._sum = 0.0
        self._lock = threading.Lock()
        self._created = time.time()

    def observe(self, amount: float, exemplar: dict[str, str] | None = None) -> None:
        """Count one observation.

        Args:
            exemplar: labels of the trace that it belongs to.
        """
        bucket = bisect_left(self._bounds, amount)
        with self._lock:
            self._sum += amount
            self._counts[bucket] += 1.0
            if exemplar:
                self._exemplars[bucket] = Exemplar(exemplar, amount, time.time())

    def add_to(self, family: HistogramMetricFamily, labels: Sequence[str]) -> None:
        """Add the samples of this series."""
        with self._lock:
            counts, exemplars, total = self._counts[:], self._exemplars[:], self._sum
        buckets: list[tuple[str, float] | tuple[str, float, Exemplar]] = []
        count = 0.0
        for bound, own, exemplar in zip(self._bounds, counts, exemplars, strict=True):
            count += own
            name = floatToGoString(bound)  # type: ignore[no-untyped-call]
            buckets.append((name, count) if exemplar is None else (name, count, exemplar))
        family.add_metric(labels, buckets, total)
        if _HAS_CREATED:
            family.add_sample(f"{family.name}_created", family.samples[-1].labels, self._created)


class Histogram(Collector):
    """A histogram in the form of ``prometheus_client``, whose samples it gives.

    Args:
        buckets: upper bounds, ascending; infinity comes after them.
    """

    def __init__(
        self,
        name: str,
        documentation: str,
        labelnames: Sequence[str] = (),
        *,
        buckets: Sequence[float],
        registry: CollectorRegistry,
    ) -> None:
        self._name, self._documentation, self._labelnames = name, documentation, tuple(labelnames)
        self._bounds = (*buckets, math.inf)
        self._series: dict[tuple[str, ...], Series] = {}
        if not labelnames:
            self.labels()
        registry.register(self)

    def labels(self, *values: str) -> Series:
        """The series of these label values, in the order of the names."""
        series = self._series.get(values)
        if series is None:
            if len(values) != len(self._labelnames):
                raise ValueError(f"{self._name} has the labels {', '.join(self._labelnames)}")
            series = self._series.setdefault(values, Series(self._bounds))
        return series

    def observe(self, amount: float) -> None:
        """Count one observation of a histogram without labels."""
        self._series[_NO_LABELS].observe(amount)

    def collect(self) -> Iterator[HistogramMetricFamily]:
        """Yield the samples of all series."""
        family = HistogramMetricFamily(self._name, self._documentation, labels=self._labelnames)
        for labels, series in list(self._series.items()):
            series.add_to(family, labels)
        yield family

    def describe(self) -> Iterator[HistogramMetricFamily]:
        """Yield the name, so that no other metric takes it."""
        yield HistogramMetricFamily(self._name, self._documentation, labels=self._labelnames)
