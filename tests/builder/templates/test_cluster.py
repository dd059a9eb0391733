"""Comparison, grouping and representatives of templates, against brute force."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from scipy.cluster.hierarchy import fcluster
from scipy.cluster.hierarchy import linkage as scipy_linkage
from scipy.spatial.distance import cdist, squareform

from firstfix.descriptor import (
    Described,
    Descriptor,
    LayeredOccupancy,
    PolarGrid,
    rows_of,
)
from firstfix.descriptor.pca_sc import PcaScanContext
from firstfix.engine.config import ClusterConfig, OccupancyConfig
from firstfix.engine.retrieval.cascade import Clusters, Templates
from firstfix.errors import BuildCancelled, BuildFailed
from firstfix_builder.templates import cluster, cluster_unconstrained
from firstfix_builder.templates.cluster import cluster_templates, most_typical, neighbour_pairs
from firstfix_builder.templates.cluster_unconstrained import cluster_pairs
from firstfix_builder.templates.linkage import Pairs

GRID = PolarGrid(6, 24, 20.0)
PCA_SC = PcaScanContext(GRID)
OCCUPANCY = LayeredOccupancy(GRID, (0.3, 1.0, 2.0, 8.0), coefficients=4)
both_descriptors = pytest.mark.parametrize("descriptor", [PCA_SC, OCCUPANCY], ids=["pca_sc", "occupancy"])
LINKAGES = ("complete", "average", "single")


def some_templates(descriptor: Descriptor, count: int, seed: int = 0) -> tuple[Described, np.ndarray]:
    """In 5 kinds of rooms, more or less cluttered: from alike to wholly unlike."""
    rng = np.random.default_rng(seed)
    kind, clutter = rng.integers(0, 5, count), rng.uniform(0, 0.7, (count, 1, 1))
    position_m = np.column_stack([rng.uniform(0, 20, (count, 2)), rng.uniform(0, 0.2, count)])
    if isinstance(descriptor, PcaScanContext):
        shape = (GRID.rings, GRID.sectors)
        rooms = rng.uniform(0.3, 6, (5, *shape)) * (rng.random((5, *shape)) < 0.4)
        other = rng.uniform(0.3, 6, (count, *shape)) * (rng.random((count, *shape)) < 0.4)
        context = np.where(rng.random((count, *shape)) < clutter, other, rooms[kind]).astype(np.float16)
        zeros = np.zeros(count, np.float32)
        return {"angle_rad": zeros, "ratio": zeros, "context": context}, position_m
    shape = (descriptor.rows, GRID.sectors)
    rooms, other = rng.random((5, *shape)) < 0.3, rng.random((count, *shape)) < 0.3
    filled = np.where(rng.random((count, *shape)) < clutter, other, rooms[kind])
    return {"occupancy": np.packbits(filled.reshape(count, -1), axis=1)}, position_m


def dense(descriptor: Descriptor, described: Described) -> np.ndarray:
    """(n, n) distances, 1 - equation 4."""
    distance = 1 - descriptor.similarity(described, described).astype(np.float64)
    np.fill_diagonal(distance, 0)
    return (distance + distance.T) / 2


def neighbours_of(position_m: np.ndarray, neighbours: int) -> set[tuple[int, int]]:
    """Unordered pairs of which one is among the other's nearest."""
    apart = cdist(position_m, position_m)
    np.fill_diagonal(apart, -1)
    order = np.argsort(apart, axis=1)[:, 1 : neighbours + 1]
    return {(min(i, j), max(i, j)) for i, row in enumerate(order.tolist()) for j in row}


def listed(pairs: Pairs) -> list[tuple[int, int]]:
    return list(zip(pairs.a.tolist(), pairs.b.tolist(), strict=True))


def all_of(parts) -> tuple[list[float], Pairs]:
    done, pairs = zip(*parts, strict=True)
    return list(done), Pairs.concatenate(pairs)


def groups(clusters: Clusters) -> set[frozenset[int]]:
    return {frozenset(clusters.members(np.array([c])).tolist()) for c in range(len(clusters))}


def scipy_groups(distance: np.ndarray, linkage: str, threshold: float) -> set[frozenset[int]]:
    label = fcluster(scipy_linkage(squareform(distance), linkage), threshold, "distance")
    return {frozenset(np.flatnonzero(label == c).tolist()) for c in np.unique(label)}


@pytest.fixture(params=[5, 64], ids=["blocks of 5", "blocks of 64"])
def small_blocks(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Templates in many blocks, the last of them not full."""
    monkeypatch.setattr(cluster, "BLOCK", request.param)
    monkeypatch.setattr(cluster, "ROWS", request.param)
    monkeypatch.setattr(cluster_unconstrained, "ROWS", request.param)


@pytest.fixture(params=["dense", "blocks"])
def unconstrained(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both ways to compare all with all, the second in several blocks."""
    if request.param == "blocks":
        monkeypatch.setattr(cluster_unconstrained, "DENSE_LIMIT", 0)
        monkeypatch.setattr(cluster_unconstrained, "ROWS", 16)


@both_descriptors
@pytest.mark.parametrize("neighbours", [1, 4, 20])
@pytest.mark.usefixtures("small_blocks")
def test_neighbour_pairs_are_the_nearest_by_position_each_once(descriptor, neighbours):
    described, position_m = some_templates(descriptor, 150)
    _, pairs = all_of(neighbour_pairs(descriptor, described, position_m, neighbours))
    assert len(set(listed(pairs))) == len(pairs)
    assert set(listed(pairs)) == neighbours_of(position_m, neighbours)
    expected = 1 - descriptor.similarity(described, described)[pairs.a, pairs.b]
    assert np.allclose(pairs.distance, expected, rtol=0, atol=1e-6)


@both_descriptors
@pytest.mark.parametrize("edges", [(0, 40, 41, 150), (0, 75, 150)])
@pytest.mark.usefixtures("small_blocks")
def test_rows_shared_out_give_every_pair_once(descriptor, edges):
    described, position_m = some_templates(descriptor, 150)
    position_m[100:] = np.round(position_m[100:])  # where many are equally near
    _, whole = all_of(neighbour_pairs(descriptor, described, position_m, 6))
    parts = [
        all_of(neighbour_pairs(descriptor, described, position_m, 6, range(first, last)))[1]
        for first, last in pairwise(edges)
    ]
    shared = Pairs.concatenate(parts)
    assert sorted(listed(shared)) == sorted(listed(whole))
    distance = dict(zip(listed(whole), whole.distance.tolist(), strict=True))
    expected = [distance[pair] for pair in listed(shared)]
    assert np.allclose(shared.distance, expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize("chunk", [16, 64, 4096])
def test_chunks_give_the_clusters_of_the_whole(chunk, monkeypatch, tmp_path):
    monkeypatch.setattr(cluster, "CHUNK", chunk)
    config = OccupancyConfig(
        rings=6, sectors=24, max_range_m=20, layer_edges_m=(0.3, 1, 2, 8), coefficients=4
    )
    descriptor = config.make()
    described, position_m = some_templates(descriptor, 130)
    height_m = np.ones(130, np.float32)
    Templates(position_m.astype(np.float32), height_m, described).save(tmp_path)
    chunks = cluster.cluster_chunks(130, 8, config)
    assert len(chunks) == -(-130 // chunk)
    pairs = [Pairs(**one.run({"templates": tmp_path})) for one in chunks]
    wanted = ClusterConfig(linkage="average", threshold=0.5, neighbours=8)
    found = cluster.cluster_by_pairs(descriptor, described, 130, pairs, wanted)
    at = position_m.astype(np.float32)
    assert groups(found) == groups(cluster_templates(descriptor, described, at, wanted))


@pytest.mark.parametrize("count", [1, 2, 5])
def test_fewer_templates_than_neighbours_are_all_compared(count):
    described, position_m = some_templates(PCA_SC, count)
    done, pairs = all_of(neighbour_pairs(PCA_SC, described, position_m, 50))
    assert sorted(listed(pairs)) == [(a, b) for a in range(count) for b in range(a + 1, count)]
    assert done == [1.0]


@pytest.mark.usefixtures("small_blocks")
def test_templates_at_one_place_are_compared_once_and_never_with_themselves():
    """A template may not be its own nearest where more share a place than neighbours are asked for."""
    described, position_m = some_templates(PCA_SC, 60)
    position_m[:] = position_m[np.arange(60) // 12]
    _, pairs = all_of(neighbour_pairs(PCA_SC, described, position_m, 3))
    assert (pairs.a < pairs.b).all()
    assert len(set(listed(pairs))) == len(pairs)
    assert (position_m[pairs.a] == position_m[pairs.b]).all()
    assert set(pairs.a.tolist()) | set(pairs.b.tolist()) == set(range(60))


@both_descriptors
@pytest.mark.parametrize("threshold", [0.0, 0.3, 0.6, 0.99])
@pytest.mark.parametrize("clusters", [13, 70])
@pytest.mark.parametrize("rows", [6, 2048])
def test_pairs_of_clusters_are_those_whose_templates_are_all_near(
    descriptor, threshold, clusters, rows, monkeypatch
):
    """All pairs of templates, where each is its own cluster."""
    monkeypatch.setattr(cluster_unconstrained, "ROWS", rows)
    described, _ = some_templates(descriptor, 70)
    label = np.random.default_rng(5).permutation(np.arange(70) % clusters)
    distance = dense(descriptor, described)
    apart = np.array(
        [[distance[np.ix_(label == i, label == j)].max() for j in range(clusters)] for i in range(clusters)]
    )
    pairs = cluster_pairs(descriptor, described, label, threshold, lambda: False)
    assert sorted(listed(pairs)) == [tuple(p) for p in np.argwhere(np.triu(apart <= threshold, 1)).tolist()]
    assert np.allclose(pairs.distance, apart[pairs.a, pairs.b], rtol=0, atol=1e-6)


@both_descriptors
@pytest.mark.parametrize("threshold", [0.2, 0.4, 0.7])
@pytest.mark.usefixtures("unconstrained")
def test_without_neighbours_it_is_scipy_s_complete_linkage(descriptor, threshold):
    described, position_m = some_templates(descriptor, 120)
    config = ClusterConfig(threshold=threshold, neighbours=None)
    clusters = cluster_templates(descriptor, described, position_m, config)
    expected = scipy_groups(dense(descriptor, described), "complete", threshold)
    assert 5 <= len(expected) < 110
    assert groups(clusters) == expected


@pytest.mark.parametrize("linkage", LINKAGES)
@pytest.mark.parametrize("threshold", [0.15, 0.35, 0.5])
def test_without_neighbours_it_is_scipy_s_linkage_of_any_kind(linkage, threshold):
    described, position_m = some_templates(PCA_SC, 100, seed=3)
    config = ClusterConfig(linkage=linkage, threshold=threshold, neighbours=None)
    clusters = cluster_templates(PCA_SC, described, position_m, config)
    assert groups(clusters) == scipy_groups(dense(PCA_SC, described), linkage, threshold)


@both_descriptors
@pytest.mark.parametrize("linkage", LINKAGES)
@pytest.mark.usefixtures("small_blocks")
def test_with_neighbours_all_others_count_as_wholly_unlike(descriptor, linkage):
    described, position_m = some_templates(descriptor, 120, seed=1)
    config = ClusterConfig(linkage=linkage, threshold=0.5, neighbours=8)
    near = np.eye(120, dtype=np.bool_)
    near[tuple(np.array(sorted(neighbours_of(position_m, 8))).T)] = True
    distance = np.where(near | near.T, dense(descriptor, described), 1)
    expected = scipy_groups(distance, linkage, 0.5)
    assert 5 <= len(expected) < 118
    assert groups(cluster_templates(descriptor, described, position_m, config)) == expected


@both_descriptors
@pytest.mark.parametrize("neighbours", [None, 30])
@pytest.mark.usefixtures("small_blocks")
def test_the_representative_is_the_most_typical_of_its_cluster(descriptor, neighbours):
    described, position_m = some_templates(descriptor, 80, seed=2)
    config = ClusterConfig(linkage="average", threshold=0.5, neighbours=neighbours)
    clusters = cluster_templates(descriptor, described, position_m, config)
    alike = descriptor.similarity(described, described).astype(np.float64)
    assert np.bincount(np.diff(clusters.start))[3:].sum() > 0
    for c, representative in enumerate(clusters.representative.tolist()):
        members = clusters.members(np.array([c])).tolist()
        total = {i: sum(alike[i, j] for j in members) for i in members}
        assert total[representative] >= max(total.values()) - 1e-4


@both_descriptors
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("rows", [3, 7, 2048])
def test_most_typical_is_equation_7(descriptor, seed, rows, monkeypatch):
    monkeypatch.setattr(cluster, "ROWS", rows)
    described, _ = some_templates(descriptor, 31, seed)
    alike = descriptor.similarity(described, described).astype(np.float64)
    best = int(alike.sum(axis=1).argmax())
    assert most_typical(descriptor, described) == best
    backwards = rows_of(described, np.arange(31)[::-1])
    assert most_typical(descriptor, backwards) == 30 - best


def test_the_most_typical_of_one_is_itself_and_of_copies_the_first():
    described, _ = some_templates(PCA_SC, 1)
    assert most_typical(PCA_SC, described) == 0
    assert most_typical(PCA_SC, rows_of(described, np.zeros(4, np.intp))) == 0


@pytest.mark.parametrize("neighbours", [None, 50])
@pytest.mark.usefixtures("unconstrained")
def test_one_template_is_one_cluster(neighbours):
    described, position_m = some_templates(PCA_SC, 1)
    clusters = cluster_templates(PCA_SC, described, position_m, ClusterConfig(neighbours=neighbours))
    assert groups(clusters) == {frozenset([0])}
    assert clusters.representative.tolist() == [0]


def test_only_complete_linkage_of_all_pairs_takes_more_than_fit_into_memory(monkeypatch):
    monkeypatch.setattr(cluster_unconstrained, "DENSE_LIMIT", 20)
    described, position_m = some_templates(PCA_SC, 21)
    for linkage in ("average", "single"):
        config = ClusterConfig(linkage=linkage, neighbours=None)
        with pytest.raises(BuildFailed, match="20"):
            cluster_templates(PCA_SC, described, position_m, config)
    few = rows_of(described, slice(0, 20))
    assert len(cluster_templates(PCA_SC, few, position_m[:20], config)) > 0


def cancelled_at(call: int) -> Callable[[], bool]:
    calls = iter(range(call))
    return lambda: next(calls, None) is None


@pytest.mark.parametrize("neighbours", [None, 5])
@pytest.mark.parametrize("call", [0, 3])
def test_a_build_that_is_cancelled_stops(neighbours, call, monkeypatch):
    monkeypatch.setattr(cluster, "BLOCK", 10)
    monkeypatch.setattr(cluster_unconstrained, "DENSE_LIMIT", 0)
    monkeypatch.setattr(cluster_unconstrained, "ROWS", 10)
    described, position_m = some_templates(PCA_SC, 60)
    progress: list[float] = []
    with pytest.raises(BuildCancelled, match="comparing"):
        cluster_templates(
            PCA_SC,
            described,
            position_m,
            ClusterConfig(neighbours=neighbours),
            progress.append,
            cancelled_at(call),
        )
    assert len(progress) <= call + 1
    assert all(0 <= done < 1 for done in progress)


@pytest.mark.parametrize("neighbours", [None, 5])
@pytest.mark.parametrize("threshold", [0.0, 0.05, 0.1, 0.3, 0.45, 0.95])
def test_progress_never_goes_back(neighbours, threshold, monkeypatch):
    monkeypatch.setattr(cluster, "BLOCK", 10)
    monkeypatch.setattr(cluster_unconstrained, "DENSE_LIMIT", 0)
    monkeypatch.setattr(cluster_unconstrained, "ROWS", 10)
    described, position_m = some_templates(PCA_SC, 64)
    progress: list[float] = []
    config = ClusterConfig(threshold=threshold, neighbours=neighbours)
    cluster_templates(PCA_SC, described, position_m, config, progress.append)
    assert progress == sorted(progress)
    assert progress[0] >= 0
    assert progress[-1] <= 1
    if neighbours:
        assert progress == pytest.approx([10 / 64, 20 / 64, 30 / 64, 40 / 64, 50 / 64, 60 / 64, 1])
