"""The cascade (paper III.C): clusters by their representatives' keys, then the templates in them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...descriptor import Described, Descriptor
from ..config import EngineConfig
from .clusters import Clusters
from .key_projection import load_projection
from .key_search import KeySearch, load_key_search
from .template_tiles import TemplateTiles
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
    tiles: where the templates stand.
    keys: of the clusters' representatives.
    projection: (d, numbers) that they were made with, or None.
    """

    descriptor: Descriptor
    templates: Templates
    tiles: TemplateTiles
    clusters: Clusters
    keys: KeySearch
    projection: NDArray[np.float32] | None = None

    def search(self, described: Described, clusters: int) -> Matches:
        """All templates of the ``clusters`` nearest by key, compared with one described scan."""
        return self.match(described, self.nearest(described, clusters))

    def nearest(self, described: Described, clusters: int) -> NDArray[np.int64]:
        return self.keys.search(self.key_of(described), clusters)

    def match(self, described: Described, clusters: NDArray[np.int64]) -> Matches:
        return self.compare(described, np.sort(self.clusters.members(clusters)))

    def search_near(
        self, described: Described, centre: NDArray[np.float64], radius_m: float, clusters: int
    ) -> Matches:
        """Only the templates within a sphere, (3,) metres: all of them where they are few, else those of
        the clusters there that are nearest by key."""
        rows = self.tiles.within(self.templates.position_m, centre, radius_m)
        if len(rows) <= clusters:
            return self.compare(described, rows)
        if len(rows) == len(self.templates):
            return self.search(described, clusters)
        near = self.keys.search_among(self.key_of(described), self._standing_for(rows), clusters)
        members = np.sort(self.clusters.members(near))
        return self.compare(described, members[np.isin(members, rows, assume_unique=True)])

    def _standing_for(self, rows: NDArray[np.int32]) -> NDArray[np.integer]:
        """The clusters whose representatives are among the templates, ascending."""
        if len(self.clusters) == len(self.templates):  # each its own: cluster i is template i
            return rows
        return np.flatnonzero(np.isin(self.clusters.representative, rows))

    def compare(self, described: Described, rows: NDArray[np.integer]) -> Matches:
        """The given templates, ascending as they lie on the disk."""
        if not len(rows):
            return Matches(rows, np.empty(0), np.empty(0))
        yaw, score = self.descriptor.match(described, self.templates.described_at(rows))
        best = np.argsort(-score, kind="stable")
        return Matches(rows[best], yaw[best], score[best])

    def key_of(self, described: Described) -> NDArray[np.float32]:
        """(numbers,) of one scan."""
        key = self.descriptor.keys(described)[0]
        return key if self.projection is None else key @ self.projection

    @classmethod
    def load(cls, directory: Path, config: EngineConfig) -> Cascade:
        """Of a version's files; arrays are memory-mapped.

        Raises:
            ValueError, TypeError, RuntimeError, OSError: a file is missing, damaged, or not of the others.
        """
        descriptor = config.descriptor.make()
        templates, clusters = Templates.load(directory, descriptor), Clusters.load(directory)
        keys = load_key_search(directory, config.search)
        if len(keys) != len(clusters):
            raise ValueError(f"{len(keys)} keys of {len(clusters)} clusters")
        tiles = TemplateTiles.load(directory, templates.position_m)
        return cls(descriptor, templates, tiles, clusters, keys, load_projection(directory))
