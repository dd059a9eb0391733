"""The cascade (paper III.C): clusters by their representatives' keys, then the templates in them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .clusters import Clusters
from .descriptor import Described, Descriptor
from .engine_config import EngineConfig
from .key_projection import load_projection
from .key_search import KeySearch, load_key_search
from .templates import Templates


@dataclass(frozen=True)
class Matches:
    """Templates compared with a scan, the most alike first.

    Attributes:
        rows: (k,) templates.
        yaw_rad: (k,) of the scan in each template's frame.
        score: (k,) 0..1.
    """

    rows: NDArray[np.integer]
    yaw_rad: NDArray[np.floating]
    score: NDArray[np.floating]


@dataclass(frozen=True)
class Cascade:
    """Attributes:
    keys: of the clusters' representatives.
    projection: (d, numbers) that they were made with, or None.
    """

    descriptor: Descriptor
    templates: Templates
    clusters: Clusters
    keys: KeySearch
    projection: NDArray[np.float32] | None = None

    def search(self, described: Described, clusters: int) -> Matches:
        """All templates of the ``clusters`` nearest by key, compared with one described scan."""
        return self.match(described, self.nearest(described, clusters))

    def nearest(self, described: Described, clusters: int) -> NDArray[np.int64]:
        return self.keys.search(self._key(described), clusters)

    def match(self, described: Described, clusters: NDArray[np.int64]) -> Matches:
        return self.compare(described, np.sort(self.clusters.members(clusters)))

    def search_among(self, described: Described, among: NDArray[np.bool_], clusters: int) -> Matches:
        """Only the templates that (n,) ``among`` names: all of them where they are few, else those of
        their clusters that are nearest by key."""
        if among.sum() <= clusters:
            return self.compare(described, np.flatnonzero(among))
        near = self.keys.search(self._key(described), len(self.clusters))
        near = near[among[self.clusters.representative[near]]][:clusters]
        rows = np.sort(self.clusters.members(near))
        return self.compare(described, rows[among[rows]])

    def compare(self, described: Described, rows: NDArray[np.integer]) -> Matches:
        """The given templates, ascending as they lie on the disk."""
        if not len(rows):
            return Matches(rows, np.empty(0), np.empty(0))
        yaw, score = self.descriptor.match(described, self.templates.described_at(rows))
        best = np.argsort(-score, kind="stable")
        return Matches(rows[best], yaw[best], score[best])

    def _key(self, described: Described) -> NDArray[np.float32]:
        """(numbers,) of one scan."""
        key = self.descriptor.keys(described)[0]
        return key if self.projection is None else key @ self.projection

    @classmethod
    def load(cls, directory: Path, config: EngineConfig) -> Cascade:
        """Of a version's files; arrays are memory-mapped."""
        descriptor = config.descriptor.make()
        return cls(
            descriptor,
            Templates.load(directory, descriptor),
            Clusters.load(directory),
            load_key_search(directory, config.search),
            load_projection(directory),
        )
