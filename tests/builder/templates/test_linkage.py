"""Linkage of sparse pairs against SciPy's on the dense matrix, where the missing pairs are at distance 1."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.cluster.hierarchy import fcluster
from scipy.cluster.hierarchy import linkage as scipy_linkage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import squareform

from firstfix_builder.templates.linkage import Pairs, agglomerate

LINKAGES = ("complete", "average", "single")
# distances are float32: as thresholds the test takes numbers that these are compared with exactly
THRESHOLDS = tuple(float(np.float32(t)) for t in (0.1, 0.2, 0.3, 0.45, 0.6, 0.75, 0.9))
every_linkage = pytest.mark.parametrize("linkage", LINKAGES)
seeds = st.integers(0, 2**32 - 1)
counts = st.integers(2, 60)
densities = st.sampled_from([0.02, 0.1, 0.3, 0.7, 1.0])
alike = settings(max_examples=150, deadline=None, derandomize=True)


def some_pairs(samples: int, share: float, seed: int, decimals: int | None = None) -> Pairs:
    """Random distances of so many pairs, shuffled. Rounded, most of them are ties."""
    rng = np.random.default_rng(seed)
    a, b = np.triu_indices(samples, 1)
    kept = rng.permutation(np.flatnonzero(rng.random(len(a)) < share))
    distance = rng.uniform(0, 1, len(kept)) ** rng.choice([0.5, 1, 2])
    if decimals is not None:
        distance = distance.round(decimals)
    swap = rng.random(len(kept)) < 0.5
    return Pairs.of(np.where(swap, b[kept], a[kept]), np.where(swap, a[kept], b[kept]), distance)


def places_pairs(samples: int, near: float, seed: int) -> Pairs:
    """Distances that obey the triangle inequality, of places that lie near each other."""
    places = np.random.default_rng(seed).uniform(0, 1, (samples, 2))
    a, b = np.triu_indices(samples, 1)
    apart = np.linalg.norm(places[a] - places[b], axis=1)
    kept = apart < near
    return Pairs.of(a[kept], b[kept], apart[kept])


def dense(samples: int, pairs: Pairs) -> np.ndarray:
    distance = 1 - np.eye(samples)
    distance[pairs.a, pairs.b] = distance[pairs.b, pairs.a] = pairs.distance
    return distance


def partition(label: np.ndarray) -> set[frozenset[int]]:
    return {frozenset(np.flatnonzero(label == c).tolist()) for c in np.unique(label)}


def scipy_clusters(samples: int, pairs: Pairs, linkage: str, threshold: float) -> set[frozenset[int]]:
    tree = scipy_linkage(squareform(dense(samples, pairs)), linkage)
    return partition(fcluster(tree, threshold, "distance"))


def between(distance: np.ndarray, linkage: str, x: list[int], y: list[int]) -> float:
    """Equations 1 to 3."""
    block = distance[np.ix_(x, y)]
    return float({"complete": block.max, "average": block.mean, "single": block.min}[linkage]())


@alike
@given(counts, densities, seeds, st.sampled_from(LINKAGES), st.sampled_from(THRESHOLDS))
def test_equals_scipy_on_the_dense_matrix(samples, share, seed, linkage, threshold):
    pairs = some_pairs(samples, share, seed)
    got = agglomerate(samples, pairs, linkage, threshold)
    assert partition(got) == scipy_clusters(samples, pairs, linkage, threshold)


@every_linkage
@pytest.mark.parametrize("seed", range(3))
def test_equals_scipy_for_a_thousand(linkage, seed):
    pairs = places_pairs(1000, 0.08, seed)
    got = agglomerate(1000, pairs, linkage, 0.025)
    assert 10 < got.max() < 900
    assert partition(got) == scipy_clusters(1000, pairs, linkage, 0.025)


@alike
@given(counts, densities, seeds, st.sampled_from(THRESHOLDS))
def test_with_ties_a_complete_cluster_has_no_pair_too_far_and_no_two_could_be_merged(
    samples, share, seed, threshold
):
    pairs = some_pairs(samples, share, seed, decimals=1)
    distance = dense(samples, pairs)
    clusters = [sorted(c) for c in partition(agglomerate(samples, pairs, "complete", threshold))]
    for i, x in enumerate(clusters):
        assert distance[np.ix_(x, x)].max() <= threshold
        for y in clusters[:i]:
            assert between(distance, "complete", x, y) > threshold


@alike
@given(counts, densities, seeds, st.sampled_from(THRESHOLDS))
def test_with_ties_no_two_average_clusters_could_be_merged(samples, share, seed, threshold):
    pairs = some_pairs(samples, share, seed, decimals=1)
    distance = dense(samples, pairs)
    clusters = [sorted(c) for c in partition(agglomerate(samples, pairs, "average", threshold))]
    for i, x in enumerate(clusters):
        for y in clusters[:i]:
            assert between(distance, "average", x, y) > threshold - 1e-7


@alike
@given(counts, densities, seeds, st.sampled_from(THRESHOLDS))
def test_single_clusters_are_what_hangs_together_ties_or_not(samples, share, seed, threshold):
    pairs = some_pairs(samples, share, seed, decimals=1)
    near = pairs.distance.astype(np.float64) <= threshold
    graph = coo_array((np.ones(near.sum()), (pairs.a[near], pairs.b[near])), shape=(samples, samples))
    _, expected = connected_components(graph, directed=False)
    assert partition(agglomerate(samples, pairs, "single", threshold)) == partition(expected)


@alike
@given(counts, densities, seeds, st.sampled_from(LINKAGES), st.sampled_from(THRESHOLDS))
def test_labels_count_up_in_the_order_of_first_samples(samples, share, seed, linkage, threshold):
    label = agglomerate(samples, some_pairs(samples, share, seed), linkage, threshold)
    assert label.shape == (samples,)
    _, first = np.unique(label, return_index=True)
    assert label[np.sort(first)].tolist() == list(range(len(first)))


@every_linkage
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("decimals", [None, 1])
def test_the_order_of_the_pairs_does_not_matter(linkage, seed, decimals):
    pairs = some_pairs(50, 0.5, seed, decimals)
    order = np.random.default_rng(seed).permutation(len(pairs))
    shuffled = Pairs(pairs.a[order], pairs.b[order], pairs.distance[order])
    expected = agglomerate(50, pairs, linkage, 0.55)
    assert np.array_equal(agglomerate(50, shuffled, linkage, 0.55), expected)


@every_linkage
@pytest.mark.parametrize("samples", [1, 2, 9])
def test_without_pairs_everyone_is_alone(linkage, samples):
    nobody = np.empty(0, np.int32)
    label = agglomerate(samples, Pairs.of(nobody, nobody, np.empty(0)), linkage, 0.9)
    assert label.tolist() == list(range(samples))


@every_linkage
@pytest.mark.parametrize("threshold", [0.1, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.75])
def test_the_threshold_itself_is_merged_and_a_hair_more_is_not(linkage, threshold):
    over = np.nextafter(np.float32(threshold), np.float32(1))
    pairs = Pairs.of(np.array([0, 3]), np.array([1, 2]), np.array([threshold, over]))
    assert agglomerate(4, pairs, linkage, threshold).tolist() == [0, 0, 1, 2]


@pytest.mark.parametrize("equal", [True, False])
def test_a_chain_of_neighbours_does_not_grow_into_one_complete_cluster(equal):
    """A chain would, if missing pairs were left out of the maximum."""
    links = np.arange(99)
    apart = np.full(99, 0.0625) if equal else np.random.default_rng(2).uniform(0.01, 0.1, 99)
    pairs = Pairs.of(links, links + 1, apart)
    sizes = np.bincount(agglomerate(100, pairs, "complete", 0.9))
    assert sizes.max() == 2
    assert np.bincount(agglomerate(100, pairs, "single", 0.9)).tolist() == [100]


def test_a_missing_pair_counts_as_1_in_the_average():
    # {0, 1} at 0.1; sample 2 is 0.2 from 0 and unknown to 1: (0.2 + 1) / 2
    pairs = Pairs.of(np.array([0, 2]), np.array([1, 0]), np.array([0.1, 0.2]))
    assert agglomerate(3, pairs, "average", 0.59).tolist() == [0, 0, 1]
    assert agglomerate(3, pairs, "average", 0.61).tolist() == [0, 0, 0]


def test_pairs_are_kept_lower_number_first():
    pairs = Pairs.of(np.array([5, 1, 7]), np.array([2, 3, 0]), np.array([0.5, 0.25, 0.125]))
    assert (pairs.a.tolist(), pairs.b.tolist()) == ([2, 1, 0], [5, 3, 7])
    both = Pairs.concatenate([pairs, Pairs.of(np.array([9]), np.array([8]), np.array([0.75]))])
    assert len(both) == 4
    assert (both.a.tolist(), both.b.tolist()) == ([2, 1, 0, 8], [5, 3, 7, 9])
    assert both.distance.tolist() == [0.5, 0.25, 0.125, 0.75]
