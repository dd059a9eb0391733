"""Keys in shards by tile, compared with one index; searches among some rows, compared with all distances."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firstfix.engine.config import SearchConfig
from firstfix.engine.retrieval.key_search import ENGINES, build_key_search, faiss_indexes, load_key_search
from firstfix.engine.retrieval.key_search.faiss_indexes import FLAT_UP_TO, chosen_engine
from firstfix.engine.retrieval.key_search.faiss_search import SHARDS_FILE
from firstfix.engine.retrieval.key_search.tile_shards import MAX_SHARDS, TILE_M, TileShards

every_engine = pytest.mark.parametrize("engine", ENGINES)
SHARDED = ("faiss_sq8", "faiss_ivf_sq8")
HALF_STEP = 0.03  # of a number in 8 bits, here and there


def world(seed: int, count: int, extent_m: float = 600.0, numbers: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """Keys (n, d) in groups, and (n, 3) positions independent of them."""
    rng = np.random.default_rng(seed)
    centres = rng.random((40, numbers))
    keys = centres[rng.integers(0, 40, count)] + rng.normal(0, 0.05, (count, numbers))
    return keys.astype(np.float32), rng.uniform(-extent_m / 2, extent_m / 2, (count, 3)).astype(np.float32)


def near(keys: np.ndarray, count: int, seed: int = 7) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return (keys[rng.integers(0, len(keys), count)] + rng.normal(0, 0.03, (count, keys.shape[1]))).astype(
        np.float32
    )


def brute(keys: np.ndarray, key: np.ndarray) -> np.ndarray:
    return np.linalg.norm(keys.astype(np.float64) - key, axis=1)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.integers(0, 1000),
    st.integers(1, 1500),
    st.sampled_from([30.0, 300.0, 5000.0]),
    st.integers(100, 500),
    st.integers(1, 600),
)
def test_shards_find_what_one_index_finds(seed, count, extent_m, shard_keys, wanted):
    keys, position_m = world(seed, count, extent_m)
    whole = build_key_search(keys, SearchConfig(engine="faiss_sq8"))
    parted = build_key_search(keys, SearchConfig(engine="faiss_sq8", shard_keys=shard_keys), position_m)
    assert len(parted) == len(whole) == count
    for key in near(keys, 3):
        found = parted.search(key, wanted)
        assert len(set(found.tolist())) == len(found) == min(wanted, count)
        nearest = brute(keys, key)[whole.search(key, wanted)]
        np.testing.assert_allclose(np.sort(brute(keys, key)[found]), np.sort(nearest), rtol=0, atol=HALF_STEP)


@pytest.mark.parametrize("engine", ["faiss_sq8", "faiss_ivf_sq8"])
def test_shards_of_short_codes_are_trained_as_one(engine):
    """All lists are searched, so the same keys are found, up to the order of equal distances."""
    keys, position_m = world(1, 4000)
    whole = build_key_search(keys, SearchConfig(engine=engine))
    parted = build_key_search(keys, SearchConfig(engine=engine, shard_keys=500), position_m)
    for key in near(keys, 20):
        assert set(parted.search(key, 50).tolist()) == set(whole.search(key, 50).tolist())


def test_of_equal_keys_the_lower_rows_come_first():
    keys, position_m = world(2, 2000)
    keys[:] = keys[np.arange(2000) % 10]  # two hundred copies of each, all over the map
    config = SearchConfig(engine="faiss_sq8", shard_keys=200)
    found = build_key_search(keys, config, position_m).search(keys[3], 2000)
    assert found[:200].tolist() == list(range(3, 2000, 10))


@pytest.mark.parametrize("engine", SHARDED)
def test_loaded_shards_answer_the_same_and_have_the_same_bytes(engine, tmp_path):
    keys, position_m = world(3, 12_000)
    config = SearchConfig(engine=engine, shard_keys=3000)
    built = build_key_search(keys, config, position_m)
    for name in ("first", "again"):
        (tmp_path / name).mkdir()
        build_key_search(keys, config, position_m).save(tmp_path / name)
    first, again = ({p.name: p.read_bytes() for p in (tmp_path / n).iterdir()} for n in ("first", "again"))
    assert first == again
    assert len(first) > 3
    assert all(name.startswith("keys") for name in first)
    loaded = load_key_search(tmp_path / "first", config)
    rows = np.arange(0, 12_000, 7)
    for key in near(keys, 5):
        assert loaded.search(key, 300).tolist() == built.search(key, 300).tolist()
        assert loaded.search_among(key, rows, 300).tolist() == built.search_among(key, rows, 300).tolist()


@every_engine
@pytest.mark.parametrize("parted", [False, True])
def test_a_search_among_some_rows_misses_none(engine, parted):
    keys, position_m = world(4, 3000)
    config = SearchConfig(engine=engine, shard_keys=400 if parted else 1_000_000)
    search = build_key_search(keys, config, position_m)
    off = HALF_STEP if chosen_engine(engine, 3000).startswith("faiss") else 1e-5
    rng = np.random.default_rng(5)
    for key in near(keys, 6):
        for size, wanted in ((1, 5), (40, 40), (700, 30), (3000, 100)):
            rows = np.sort(rng.choice(3000, size, replace=False)).astype(np.int32)
            found = search.search_among(key, rows, wanted)
            assert len(set(found.tolist())) == len(found) == min(wanted, size)
            assert np.isin(found, rows).all()
            away = brute(keys, key)
            assert away[found].max() <= np.sort(away[rows])[: len(found)][-1] + off
            assert (np.diff(away[found]) >= -off).all()


@pytest.mark.parametrize(
    ("engine", "least"),  # measured: 0.975, 0.974
    [("faiss_sq8", 0.95), ("faiss_ivf_sq8", 0.93)],
)
def test_in_shards_most_of_the_nearest_hundred_are_found(engine, least):
    keys, position_m = world(6, 40_000, numbers=32)
    search = build_key_search(keys, SearchConfig(engine=engine, shard_keys=6000), position_m)
    shares = []
    for key in near(keys, 40):
        exact = np.argsort(brute(keys, key), kind="stable")[:100]
        shares.append(np.isin(exact, search.search(key, 100)).mean())
    assert np.mean(shares) > least


@pytest.mark.parametrize("parted", [False, True])
def test_more_lists_are_looked_into_where_more_rows_are_wanted(parted, monkeypatch):
    """Keys without groups, the worst case: with the lists of few rows, the last of many would be missed."""
    monkeypatch.setattr(faiss_indexes, "IVF_PROBES", 4)
    rng = np.random.default_rng(8)
    keys, position_m = rng.random((30_000, 24), np.float32), rng.uniform(0, 900, (30_000, 3))
    config = SearchConfig(engine="faiss_ivf_sq8", shard_keys=5000 if parted else 1_000_000)
    search = build_key_search(keys, config, position_m)
    shares = {}
    for wanted in (400, 4000):
        exact = [np.argsort(brute(keys, key), kind="stable")[:wanted] for key in keys[:20]]
        found = [search.search(key, wanted) for key in keys[:20]]
        assert all(len(rows) == wanted for rows in found)
        shares[wanted] = np.mean([np.isin(e, f).mean() for e, f in zip(exact, found, strict=True)])
    assert shares[4000] > shares[400] + 0.1


@pytest.mark.parametrize("parted", [False, True])
def test_many_keys_at_once_are_answered_as_one_by_one(parted):
    keys, position_m = world(8, 12_000)
    config = SearchConfig(engine="faiss_ivf_sq8", shard_keys=2000 if parted else 1_000_000)
    search = build_key_search(keys, config, position_m)
    lists, asked = search.key_lists(), near(keys, 30)
    assert np.array_equal(np.sort(lists.row), np.arange(len(keys)))
    decoded = lists.keys[np.argsort(lists.row)]
    found = lists.search(asked, 100)
    assert found.shape == (30, 100)
    for key, rows in zip(asked, found, strict=True):
        alone = search.search(key, 100)
        assert len(set(rows.tolist()) & set(alone.tolist())) >= 98  # sums of another order
        np.testing.assert_allclose(brute(decoded[rows], key), brute(decoded[alone], key), rtol=0, atol=1e-5)


def test_an_index_without_lists_has_no_key_lists():
    assert build_key_search(world(8, 500)[0], SearchConfig(engine="faiss_sq8")).key_lists() is None


@pytest.mark.parametrize("parted", [False, True])
def test_missing_keys_of_lists_are_marked(parted, monkeypatch):
    monkeypatch.setattr(faiss_indexes, "IVF_PROBES", 1)
    monkeypatch.setattr(faiss_indexes, "PROBED_ROWS", 2000)
    keys, position_m = world(9, 3000)
    config = SearchConfig(engine="faiss_ivf_sq8", shard_keys=500 if parted else 1_000_000)
    search = build_key_search(keys, config, position_m)
    found = search.key_lists().search(keys[:20], 2000)
    there = found >= 0
    assert np.array_equal(np.sort(there, axis=1)[:, ::-1], there), "the marks come last"
    assert 0 < there.sum(axis=1).max() < 2000
    assert np.array_equal(found[:, 0], np.arange(20)), "each key is the nearest to itself"
    monkeypatch.setattr(faiss_indexes, "PROBED_ROWS", 500)
    more = search.key_lists().search(keys[:20], 2000) >= 0
    assert more.sum() > there.sum()


def test_a_missing_truncated_or_foreign_shard_is_an_error(tmp_path):
    keys, position_m = world(7, 2000)
    config = SearchConfig(engine="faiss_sq8", shard_keys=300)
    build_key_search(keys, config, position_m).save(tmp_path)
    victim, other = tmp_path / "keys_001.faiss", tmp_path / "keys_002.faiss"
    content = victim.read_bytes()
    for damage in (None, content[:100], other.read_bytes()):
        victim.unlink()
        if damage is not None:
            victim.write_bytes(damage)
        with pytest.raises((RuntimeError, ValueError, OSError)):
            load_key_search(tmp_path, config)
        victim.write_bytes(content)
    table = tmp_path / SHARDS_FILE
    table.write_bytes(table.read_bytes()[:-1])
    with pytest.raises(ValueError, match="cut off"):
        load_key_search(tmp_path, config)


def test_small_maps_are_read_whole_and_large_ones_by_lists():
    assert chosen_engine("auto", FLAT_UP_TO) == "faiss_sq8"
    assert chosen_engine("auto", FLAT_UP_TO + 1) == "faiss_ivf_sq8"


@settings(max_examples=80, deadline=None, derandomize=True)
@given(
    st.integers(0, 1000),
    st.integers(1, 3000),
    st.sampled_from([10.0, 900.0, 20_000.0]),
    st.integers(100, 900),
)
def test_shards_hold_every_row_once_and_tiles_together(seed, count, extent_m, most):
    _, position_m = world(seed, count, extent_m)
    shards = TileShards.of(position_m, most)
    assert np.array_equal(np.sort(shards.row), np.arange(count))
    assert np.array_equal(shards.row[shards.place], np.arange(count))
    tile = np.floor(position_m[:, :2] / TILE_M)
    shard_of = np.searchsorted(shards.begin, shards.place, side="right") - 1
    for number in range(len(shards)):
        rows = shards.row[shards.begin[number] : shards.begin[number + 1]]
        assert (np.diff(rows) > 0).all()
        tiles = np.unique(tile[rows], axis=0)
        assert 0 < len(rows) <= max(most, -(-count // MAX_SHARDS)) or len(tiles) == 1
    for here in np.unique(tile, axis=0):
        assert len(np.unique(shard_of[(tile == here).all(axis=1)])) == 1
    chosen = np.flatnonzero(np.random.default_rng(seed).random(count) < 0.3)
    parts = np.split(shards.row, shards.begin[1:-1])
    back = [parts[shard][at] for shard, at in shards.split(chosen)]
    assert np.array_equal(np.sort(np.concatenate([chosen[:0], *back])), chosen)
