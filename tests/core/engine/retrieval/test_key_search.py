"""Every engine, compared with all distances in double precision, sorted."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path

import faiss
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firstfix.engine.config import LshConfig, SearchConfig
from firstfix.engine.retrieval.key_search import ENGINES, build_key_search, load_key_search
from firstfix.engine.retrieval.key_search.lsh_kd_tree import _nearest_flips

EXACT = ("exhaustive", "kdtree")
EIGHT_BITS = ("auto", "faiss_sq8", "faiss_ivf_sq8")
every_engine = pytest.mark.parametrize("engine", ENGINES)


def clustered_keys(seed: int, count: int) -> np.ndarray:
    """(n, 20) in 50 groups, as rings' keys are; the same groups for every count."""
    rng = np.random.default_rng(seed)
    centres = rng.random((50, 20))
    return (centres[rng.integers(0, 50, count)] + rng.normal(0, 0.05, (count, 20))).astype(np.float32)


def near(keys: np.ndarray, count: int, seed: int = 77) -> np.ndarray:
    """(count, d) queries, each a little off one of the keys."""
    rng = np.random.default_rng(seed)
    chosen = keys[rng.integers(0, len(keys), count)]
    return (chosen + rng.normal(0, 0.03, chosen.shape)).astype(np.float32)


def distances(keys: np.ndarray, key: np.ndarray) -> np.ndarray:
    return np.linalg.norm(keys.astype(np.float64) - key.astype(np.float64), axis=1)


def nearest(keys: np.ndarray, key: np.ndarray, count: int) -> list[int]:
    return np.argsort(distances(keys, key), kind="stable")[:count].tolist()


def lsh(**how) -> SearchConfig:
    return SearchConfig(engine="lsh_kdtree", lsh=LshConfig(**how))


def recall(search, queries: np.ndarray, expected: list[list[int]]) -> np.ndarray:
    """(q,) share of each query's nearest that are found."""
    found = [search.search(q, len(rows)).tolist() for q, rows in zip(queries, expected, strict=True)]
    return np.array([len(set(a) & set(b)) / len(b) for a, b in zip(found, expected, strict=True)])


def files(directory: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in directory.iterdir()}


def saved(search, directory: Path) -> Path:
    directory.mkdir()
    search.save(directory)
    return directory


KEYS = clustered_keys(0, 5000)
QUERIES = near(KEYS, 50)
TEN_NEAREST = [nearest(KEYS, query, 10) for query in QUERIES]
FEW = clustered_keys(1, 600)


@every_engine
def test_a_loaded_search_answers_as_the_built_one(engine, tmp_path):
    config = SearchConfig(engine=engine)
    built = build_key_search(FEW, config)
    loaded = load_key_search(saved(built, tmp_path / "a"), config)
    for query in near(FEW, 8):
        for count in (1, 10, 400):
            assert loaded.search(query, count).tolist() == built.search(query, count).tolist()


@every_engine
@pytest.mark.parametrize("count", [1, 40, 1000])
def test_saving_writes_the_same_bytes_every_time(engine, count, tmp_path):
    """A version is named by its content, whoever built it with however many threads."""
    config, keys = SearchConfig(engine=engine), clustered_keys(2, count)
    built = build_key_search(keys, config)
    first = files(saved(built, tmp_path / "first"))
    assert first
    assert all(name.startswith("keys") for name in first)
    assert files(saved(built, tmp_path / "again")) == first
    faiss.omp_set_num_threads(3)
    assert files(saved(build_key_search(keys.copy(), config), tmp_path / "anew")) == first


@every_engine
def test_rows_come_nearest_first_and_once(engine):
    search = build_key_search(KEYS, SearchConfig(engine=engine))
    # 8 bits over a range of about 1.3: at most half a step off in each of 20 numbers, here and there
    off = 1.4 / 255 * np.sqrt(20) if engine in EIGHT_BITS else 1e-6
    for query in QUERIES[:8]:
        rows = search.search(query, 300)
        assert 10 < len(rows) <= 300
        assert len(set(rows.tolist())) == len(rows)
        assert np.issubdtype(rows.dtype, np.integer)
        far = distances(KEYS, query)[rows]
        assert (np.diff(far) >= -off).all()
        assert far[-1] > far[0] + 2 * off


@pytest.mark.parametrize("engine", EXACT)
@pytest.mark.parametrize("count", [1, 10, 599, 600])
def test_the_exact_engines_find_the_nearest_in_order(engine, count):
    search = build_key_search(FEW, SearchConfig(engine=engine))
    for query in near(FEW, 10):
        far = distances(FEW, query)
        rows = search.search(query, count)
        assert np.allclose(far[rows], np.sort(far)[:count], rtol=0, atol=1e-5)
        if count <= 10:
            assert rows.tolist() == nearest(FEW, query, count)


@every_engine
def test_more_than_there_are_gives_all(engine):
    keys = clustered_keys(3, 50)
    config = SearchConfig(engine=engine, lsh=LshConfig(probes=64))
    search = build_key_search(keys, config)
    for count in (50, 51, 4000):
        assert sorted(search.search(keys[7], count).tolist()) == list(range(50))
        assert search.search(keys[7], count)[0] == 7


@every_engine
def test_one_key_alone_is_found(engine, tmp_path):
    config, keys = SearchConfig(engine=engine), clustered_keys(4, 1)
    search = build_key_search(keys, config)
    loaded = load_key_search(saved(search, tmp_path / "one"), config)
    for count in (1, 5):
        assert search.search(keys[0], count).tolist() == [0]
        assert loaded.search(keys[0], count).tolist() == [0]


@every_engine
def test_copies_of_a_key_are_all_found(engine):
    keys = clustered_keys(5, 200).repeat(3, axis=0)
    search = build_key_search(keys, SearchConfig(engine=engine))
    for row in range(0, 600, 60):
        rows = search.search(keys[row], 3).tolist()
        assert sorted(rows) == [row, row + 1, row + 2]


def test_one_dimensional_and_constant_keys_are_found():
    rng = np.random.default_rng(8)
    line = rng.permutation(200).astype(np.float32)[:, None]
    constant = np.concatenate([rng.random((200, 3)), np.ones((200, 5))], axis=1).astype(np.float32)
    for keys, engine in product((line, constant), ENGINES):
        search = build_key_search(keys, SearchConfig(engine=engine))
        assert search.search(keys[17], 5)[0] == 17, engine


@pytest.mark.parametrize(
    ("engine", "least"),  # measured: 0.998, 0.97
    [("lsh_kdtree", 0.98), ("faiss_sq8", 0.93)],
)
def test_approximate_engines_find_nearly_all_of_the_ten_nearest(engine, least):
    search = build_key_search(KEYS, SearchConfig(engine=engine))
    assert recall(search, QUERIES, TEN_NEAREST).mean() > least


def test_ivf_leaves_most_lists_out_and_still_finds_most():
    """Uniform keys, the worst case, in 156 lists: 128 of them are searched."""
    keys = np.random.default_rng(12).random((40_000, 20)).astype(np.float32)
    queries = near(keys, 50)
    search = build_key_search(keys, SearchConfig(engine="faiss_ivf_sq8"))
    assert len(search.search(queries[0], 400)) == 400
    assert recall(search, queries, [nearest(keys, query, 10) for query in queries]).mean() > 0.9


@pytest.mark.parametrize(("bits", "tables"), [(1, 0), (4, 2), (6, 0), (6, 2), (24, 1)])
def test_lsh_that_looks_everywhere_is_exact(bits, tables):
    keys = clustered_keys(9, 800)[:, :8]  # 24 bits are as many as there are dimensions
    search = build_key_search(keys, lsh(bits=bits, random_tables=tables, probes=256))
    for query in near(keys, 25):
        assert search.search(query, 10).tolist() == nearest(keys, query, 10)


def test_lsh_looks_only_where_its_hash_says():
    """PCA-BP with one bit: on one side of the mean, along the direction in which the keys differ most."""
    rng = np.random.default_rng(10)
    keys = rng.normal(0, [0.1, 5, 0.1], (400, 3)).astype(np.float32)
    side = keys[:, 1] > keys[:, 1].mean()
    rows = build_key_search(keys, lsh(bits=1, random_tables=0, probes=1)).search(keys[3], 150)
    of_side = side[rows] == side[3]
    assert of_side.mean() > 0.98  # the direction is the axis but for a fraction of a degree
    assert len(build_key_search(keys, lsh(bits=1, random_tables=0, probes=2)).search(keys[3], 400)) == 400


@pytest.mark.parametrize("tables", [0, 2])
def test_more_probes_never_find_less(tables):
    last = np.zeros(len(QUERIES))
    for probes in (1, 3, 64):
        search = build_key_search(KEYS, lsh(probes=probes, random_tables=tables))
        now = recall(search, QUERIES, TEN_NEAREST)
        assert (now >= last).all()
        last = now
    assert (last == 1).all()


@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.lists(st.integers(0, 6), min_size=1, max_size=8), st.integers(1, 300))
def test_nearest_flips_are_the_cheapest_masks(cost, count):
    """Compared with all masks. Costs are whole numbers, so that equal sums are equal and sorted by mask."""
    sums = [(sum(c for bit, c in enumerate(cost) if mask >> bit & 1), mask) for mask in range(1 << len(cost))]
    expected = [mask for _, mask in sorted(sums)[:count]]
    assert _nearest_flips(np.array(cost, np.float32), count) == expected
    assert expected[0] == 0


@every_engine
def test_four_threads_get_the_answers_of_one(engine):
    search = build_key_search(FEW, SearchConfig(engine=engine))
    queries = list(near(FEW, 30))
    expected = [search.search(query, 10).tolist() for query in queries]
    with ThreadPoolExecutor(4) as pool:
        got = list(pool.map(lambda query: search.search(query, 10).tolist(), queries * 2))
    assert got == expected * 2


def test_lsh_looks_further_where_its_buckets_are_empty():
    keys = np.random.default_rng(12).random((12, 20), dtype=np.float32)
    search = build_key_search(keys, SearchConfig(engine="lsh_kdtree"))
    for query in np.random.default_rng(13).normal(0.5, 2.0, (200, 20)).astype(np.float32):
        rows = search.search(query, 5)
        assert len(set(rows.tolist())) == 5
