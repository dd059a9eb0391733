"""The cascade (paper III.C): find clusters by key, then compare the templates in them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import native
from ...descriptor import Described, Descriptor, LayeredOccupancy, rows_of
from ..array_file import check_numbers
from ..config import EngineConfig
from .key_search import KeySearch, load_key_search
from .template_tiles import TemplateTiles

PREFIX = "template_"


@dataclass(frozen=True)
class Templates:
    """Templates in the index's levelled frame, n of them. Each sensor has the orientation of the frame.

    Attributes:
        position_m: (n, 3) float32 of the sensor.
        height_m: (n,) float32 of the sensor above its floor.
        described: their descriptions by the version's descriptor, n rows.
    """

    position_m: NDArray[np.float32]
    height_m: NDArray[np.float32]
    described: Described

    def __len__(self) -> int:
        return len(self.position_m)

    @cached_property
    def usual_height_m(self) -> float:
        """Median height of the sensor above its floor."""
        return float(np.median(self.height_m))

    def described_at(self, rows: NDArray[np.integer]) -> Described:
        """Descriptions of (k,) templates."""
        return rows_of(self.described, rows)

    def save(self, directory: Path) -> None:
        """Write a version's files."""
        for name, array in self._arrays().items():
            np.save(directory / f"{PREFIX}{name}.npy", array)

    @classmethod
    def load(cls, directory: Path, descriptor: Descriptor) -> Templates:
        """Read a version's files, memory-mapped: replicas on one machine share the pages.

        Raises:
            ValueError, OSError: a file is missing or damaged, or does not fit the others.
        """

        def read(name: str) -> NDArray[Any]:
            # views of a plain array are made quicker than those of a memmap
            return np.asarray(np.load(directory / f"{PREFIX}{name}.npy", mmap_mode="r"))

        templates = cls(
            read("position_m"), read("height_m"), {name: read(name) for name in descriptor.arrays}
        )
        for name, array in templates._arrays().items():
            if not array.ndim or len(array) != len(templates):
                raise ValueError(f"{PREFIX}{name}.npy does not have a row for each template")
        return templates

    @classmethod
    def concatenate(cls, parts: list[Templates]) -> Templates:
        """Templates of all parts, in order."""
        arrays = [part._arrays() for part in parts]
        whole = {name: np.concatenate([a[name] for a in arrays]) for name in arrays[0]}
        return cls(whole.pop("position_m"), whole.pop("height_m"), whole)

    def _arrays(self) -> Described:
        return {"position_m": self.position_m, "height_m": self.height_m, **self.described}


@dataclass(frozen=True)
class Clusters:
    """c clusters of n templates.

    Attributes:
        representative: (c,) int32, template that represents each cluster.
        start: (c + 1,) int32, cluster i holds ``member[start[i]:start[i + 1]]``.
        member: (n,) int32, templates, cluster after cluster, ascending in each.
    """

    representative: NDArray[np.int32]
    start: NDArray[np.int32]
    member: NDArray[np.int32]

    @classmethod
    def alone(cls, count: int) -> Clusters:
        """Clusters of one template each."""
        every = np.arange(count + 1, dtype=np.int32)
        return cls(every[:-1], every, every[:-1])

    @classmethod
    def from_labels(
        cls, label: NDArray[np.intp], most_typical: Callable[[NDArray[np.int32]], int]
    ) -> Clusters:
        """Clusters from labels.

        Args:
            label: (n,) cluster of each template, 0 to c - 1, none of them empty.
            most_typical: returns which of the (k,) templates of a cluster, two or more, represents it, 0 to k
                - 1.
        """
        member = np.argsort(label, kind="stable").astype(np.int32)
        start = np.concatenate([[0], np.cumsum(np.bincount(label))]).astype(np.int32)
        groups = np.split(member, start[1:-1])
        chosen = [group[most_typical(group) if len(group) > 1 else 0] for group in groups]
        return cls(np.array(chosen, np.int32), start, member)

    def __len__(self) -> int:
        return len(self.representative)

    def members(self, clusters: NDArray[np.integer]) -> NDArray[np.int32]:
        """Templates (m,) of (k,) clusters, in the order of the clusters."""
        if len(self) == len(self.member):  # one in each, as where templates are not clustered
            return self.member[clusters]
        begin, end = self.start[clusters], self.start[np.asarray(clusters) + 1]
        size = end - begin
        before = np.cumsum(size) - size  # members of all earlier clusters
        return self.member[np.repeat(begin - before, size) + np.arange(size.sum())]

    def save(self, directory: Path) -> None:
        """Write a version's files."""
        for field in fields(self):
            np.save(directory / f"cluster_{field.name}.npy", getattr(self, field.name))

    @classmethod
    def load(cls, directory: Path) -> Clusters:
        """Read a version's files, memory-mapped.

        Raises:
            ValueError, OSError: a file is missing or damaged, or does not fit the others.
        """
        clusters = cls(
            **{
                f.name: np.asarray(np.load(directory / f"cluster_{f.name}.npy", mmap_mode="r"))
                for f in fields(cls)
            }
        )
        start, count = clusters.start, len(clusters)
        if start.shape != (count + 1,) or start[0] != 0 or start[-1] != len(clusters.member):
            raise ValueError("cluster_start.npy does not fit the clusters and their members")
        check_numbers("cluster_start.npy", start, len(clusters.member) + 1, ascending=True)
        check_numbers("cluster_member.npy", clusters.member, len(clusters.member))
        check_numbers("cluster_representative.npy", clusters.representative, len(clusters.member))
        return clusters


FoundTemplates = tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float32]]  # as of Matches
PROJECTION_FILE = "key_projection.npy"


@dataclass(frozen=True)
class Matches:
    """Templates compared with a scan, most similar first.

    Attributes:
        rows: (k,) of the templates.
        yaw_rad: (k,) yaw of the scan in each template's frame.
        score: (k,) similarity, 0..1.
    """

    rows: NDArray[np.int64]
    yaw_rad: NDArray[np.float64]
    score: NDArray[np.float32]


@dataclass(frozen=True)
class Cascade:
    """Retrieval of one map version: from a described scan to matching templates.

    Attributes:
        tiles: templates by position.
        keys: search over the keys of the clusters' representatives.
        projection: (d, numbers) learned projection of the keys, or None.
    """

    descriptor: Descriptor
    templates: Templates
    tiles: TemplateTiles
    clusters: Clusters
    keys: KeySearch
    projection: NDArray[np.float32] | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def search(self, described: Described, clusters: int) -> Matches:
        """Compare one described scan with all templates of the ``clusters`` nearest by key."""
        if self.compiled is not None:
            return Matches(*self.compiled.search(described["occupancy"][0], clusters))
        if clusters >= len(self.clusters):
            return self.compare(described, np.arange(len(self.templates)))
        return self.match(described, self.nearest(described, clusters))

    def finder(self, described: Described) -> Callable[..., FoundTemplates]:
        """How the compiled search asks for the templates that resemble a described scan, where it must.

        Returns:
            a function of a sphere's centre, (3,) metres or None, its radius, and a number of clusters.
        """

        def find(centre: NDArray[np.float64] | None, radius_m: float, clusters: int) -> FoundTemplates:
            if centre is None:
                found = self.search(described, clusters)
            else:
                found = self.search_near(described, centre, radius_m, clusters)
            return found.rows, found.yaw_rad, found.score

        return find

    def nearest(self, described: Described, clusters: int) -> NDArray[np.int64]:
        """Rows (k,) of at most so many clusters, nearest by key first."""
        return self.keys.search(self.key_of(described), clusters)

    def match(self, described: Described, clusters: NDArray[np.int64]) -> Matches:
        """Compare one described scan with all templates of (k,) clusters."""
        return self.compare(described, np.sort(self.clusters.members(clusters)))

    def search_near(
        self, described: Described, centre: NDArray[np.float64], radius_m: float, clusters: int
    ) -> Matches:
        """Compare one described scan with templates inside a sphere only.

        All templates inside are compared if they are few, else those of the clusters nearest by key.

        Args:
            centre: (3,) metres.
        """
        if self.compiled is not None:
            occupancy = described["occupancy"][0]
            return Matches(*self.compiled.search_near(occupancy, centre, radius_m, clusters))
        rows = self.tiles.within(self.templates.position_m, centre, radius_m)
        if len(rows) <= clusters:
            return self.compare(described, rows)
        if len(rows) == len(self.templates):
            return self.search(described, clusters)
        near = self.keys.search_among(self.key_of(described), self._represented_by(rows), clusters)
        members = np.sort(self.clusters.members(near))
        return self.compare(described, members[np.isin(members, rows, assume_unique=True)])

    def _represented_by(self, rows: NDArray[np.int32]) -> NDArray[np.integer]:
        """Clusters whose representatives are among the templates, ascending."""
        if len(self.clusters) == len(self.templates):  # each its own: cluster i is template i
            return rows
        return np.flatnonzero(np.isin(self.clusters.representative, rows))

    def compare(self, described: Described, rows: NDArray[np.integer]) -> Matches:
        """Compare one described scan with (k,) templates, in ascending order as on the disk."""
        if not len(rows):
            return Matches(np.empty(0, np.int64), np.empty(0), np.empty(0, np.float32))
        yaw, score = self.descriptor.match(described, self.templates.described, rows)
        best = np.argsort(-score, kind="stable")
        return Matches(rows[best].astype(np.int64), yaw[best].astype(np.float64), score[best])

    def key_of(self, described: Described) -> NDArray[np.float32]:
        """(numbers,) key of one scan, projected if the version has a projection."""
        key = self.descriptor.keys(described)[0]
        return key if self.projection is None else key @ self.projection

    @cached_property
    def places(self) -> native.TemplatePlaces:
        """The templates by their places, as the compiled search reads them."""
        tiles = self.tiles
        return native.TemplatePlaces(
            self.templates.position_m, self.templates.height_m, tiles.row, tiles.begin, tiles.low
        )

    @cached_property
    def compiled(self) -> native.Cascade | None:
        """The same, compiled, for the default descriptor and keys in one list of 8-bit codes; else None."""
        descriptor, keys = self.descriptor, self.keys
        codes = keys.codes()
        if codes is None or not isinstance(descriptor, LayeredOccupancy):
            return None
        clusters, tiles = self.clusters, self.tiles
        return native.Cascade(
            self.templates.position_m,
            self.templates.described["occupancy"],
            descriptor.grid.rings,
            descriptor.grid.sectors,
            descriptor.grid.max_range_m,
            np.asarray(descriptor.edges_m, np.float32),
            descriptor.coefficients,
            *(clusters.representative, clusters.start, clusters.member),
            *(tiles.row, tiles.begin, tiles.low),
            self.projection,
            *(codes.codes, codes.lowest, codes.range),
        )

    @classmethod
    def load(cls, directory: Path, config: EngineConfig) -> Cascade:
        """Read a version's files. Arrays are memory-mapped.

        Raises:
            ValueError, TypeError, RuntimeError, OSError: a file is missing or damaged, or does not fit
                the others.
        """
        descriptor = config.descriptor.make()
        templates = Templates.load(directory, descriptor)
        clusters = Clusters.load(directory)
        if len(clusters.member) != len(templates):
            raise ValueError(f"{len(clusters.member)} members of clusters for {len(templates)} templates")
        keys = load_key_search(directory, config.search)
        if len(keys) != len(clusters):
            raise ValueError(f"{len(keys)} keys for {len(clusters)} clusters")
        tiles = TemplateTiles.load(directory, templates.position_m)
        cascade = cls(descriptor, templates, tiles, clusters, keys, load_projection(directory))
        _ = cascade.compiled, cascade.places  # check that the tables fit
        return cascade


def save_projection(projection: NDArray[np.float32], directory: Path) -> None:
    """Write a learned projection of the keys."""
    np.save(directory / PROJECTION_FILE, projection)


def load_projection(directory: Path) -> NDArray[np.float32] | None:
    """(d, numbers) by which keys are multiplied from the right, or None: keys are not projected."""
    path = directory / PROJECTION_FILE
    return np.load(path) if path.exists() else None
