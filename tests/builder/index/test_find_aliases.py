"""Known aliases of templates: two corridors that are alike find each other, however the work is split."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.engine.config import AliasConfig, EngineConfig, SearchConfig
from firstfix.engine.retrieval.alias_table import NONE, AliasTable
from firstfix.engine.retrieval.cascade import Cascade, Clusters, Templates
from firstfix.engine.retrieval.key_search import build_key_search
from firstfix.engine.retrieval.key_search.key_lists import KeyLists
from firstfix.engine.retrieval.template_tiles import TemplateTiles
from firstfix.native import SPOT_DEG, SPOT_M
from firstfix_builder.index import find_aliases as module
from firstfix_builder.index.find_aliases import find_aliases

STEP_M, COUNT = 1.0, 30  # templates of a corridor
TURNED = 15  # sectors of 6 degrees, by which the second corridor is turned from the first


def corridors(count: int = COUNT) -> Cascade:
    """A corridor along x, the same one turned by 90 degrees far off, and as many templates of neither."""
    descriptor = EngineConfig().descriptor
    made, rng = descriptor.make(), np.random.default_rng(5)
    shape = (count, (len(descriptor.layer_edges_m) - 1) * descriptor.rings, descriptor.sectors)
    along = rng.random(shape) < 0.1
    for one in range(1, count):  # neighbours look alike
        along[one] = np.where(rng.random(shape[1:]) < 0.8, along[one - 1], along[one])
    cells = np.concatenate([along, np.roll(along, TURNED, axis=2), rng.random(shape) < 0.1])
    described = {"occupancy": np.packbits(cells.reshape(len(cells), -1), axis=1)}
    at, zero = np.arange(count) * STEP_M, np.zeros(count)
    position_m = np.concatenate(
        [
            np.column_stack([at, zero, zero + 1]),
            np.column_stack([zero + 80, at, zero + 1]),
            np.column_stack([at, zero - 60, zero + 1]),
        ]
    ).astype(np.float32)
    templates = Templates(position_m, np.ones(len(position_m), np.float32), described)
    keys = build_key_search(made.keys(described), SearchConfig(engine="exhaustive"))
    return Cascade(made, templates, TemplateTiles.of(position_m), Clusters.alone(len(position_m)), keys, None)


def keys_of(cascade: Cascade) -> NDArray[np.float32]:
    """Keys of the clusters, each of one template."""
    return cascade.descriptor.keys(cascade.templates.described)


def assert_equal(table: AliasTable, other: AliasTable) -> None:
    """Both have the same arrays."""
    for one in fields(AliasTable):
        assert np.array_equal(getattr(table, one.name), getattr(other, one.name))


@pytest.fixture(scope="module")
def cascade() -> Cascade:
    return corridors()


@pytest.fixture(scope="module")
def table(cascade):
    return find_aliases(cascade, keys_of(cascade), AliasConfig(each=4, clusters=40))


def test_each_place_of_a_corridor_has_its_twin_first_with_the_heading_between_them(table):
    twin = np.concatenate([np.arange(COUNT) + COUNT, np.arange(COUNT)])
    own, alias, yaw_rad, score = table.of(np.arange(2 * COUNT))
    first = np.array([np.flatnonzero(own == template)[0] for template in range(2 * COUNT)])
    assert np.array_equal(alias[first], twin)
    assert np.all(score[first] == 1)
    expected = np.where(np.arange(2 * COUNT) < COUNT, 1, -1) * math.radians(6 * TURNED)
    assert np.cos(yaw_rad[first] - expected).min() > math.cos(math.radians(1))


def test_no_alias_is_beside_the_template_or_beside_another_alias(cascade, table):
    position_m = cascade.templates.position_m
    for template in range(len(position_m)):
        _, alias, yaw_rad, _ = table.of(np.array([template]))
        assert len(alias) == 4
        at, yaw = [position_m[template], *position_m[alias]], [0.0, *yaw_rad]
        for one in range(len(at)):
            for other in range(one):
                apart = np.linalg.norm(at[one] - at[other]) >= SPOT_M
                turned = math.cos(yaw[one] - yaw[other]) <= math.cos(math.radians(SPOT_DEG - 1))
                assert apart or turned


@pytest.mark.parametrize(("at_once", "threads"), [(1, 1), (7, 3), (1000, 2)])
def test_the_table_is_the_same_however_the_work_is_split(cascade, table, monkeypatch, at_once, threads):
    monkeypatch.setattr(module, "AT_ONCE", at_once)
    monkeypatch.setattr(module.os, "cpu_count", lambda: threads)
    again = find_aliases(cascade, keys_of(cascade), AliasConfig(each=4, clusters=40))
    assert_equal(again, table)


def test_matrices_of_keys_give_the_same_table_in_every_run_and_with_any_threads(monkeypatch):
    """Every key is there twice, as the corridors' are equal."""
    long = corridors(200)
    keys = keys_of(long)
    monkeypatch.setattr(module, "AT_ONCE", 200)
    assert module.AT_ONCE * keys.shape[1] >= 128_000, "FAISS multiplies matrices"
    tables = []
    for threads in (1, 2, 2):
        monkeypatch.setattr(module.os, "cpu_count", lambda threads=threads: threads)
        tables.append(find_aliases(long, keys, AliasConfig(each=4, clusters=41)))
    for again in tables[1:]:
        assert all(np.array_equal(vars(again)[name], array) for name, array in vars(tables[0]).items())


@pytest.mark.parametrize("projected", [False, True])
@pytest.mark.parametrize("count", [1, 30, 200])
def test_the_clusters_are_those_with_the_nearest_keys(projected, count):
    long, keys = corridors(200), keys_of(corridors(200))
    projection = np.random.default_rng(6).normal(0, 0.1, (keys.shape[1], 12)).astype(np.float32)
    if projected:
        long, keys = replace(long, projection=projection), keys @ projection
    rows = np.arange(100, 100 + count)
    found = module._nearest(long, keys, None, rows, 50)
    away = np.linalg.norm(keys[rows, None].astype(np.float64) - keys, axis=2)
    assert found.shape == (count, 50)
    assert all(len(set(row)) == 50 for row in found.tolist())
    assert np.allclose(np.take_along_axis(away, found, 1), np.sort(away, axis=1)[:, :50], rtol=0, atol=1e-3)


def test_aliases_are_those_of_a_search_by_hand_among_all(cascade):
    """The most similar first, each unless it is of the spot of the template or of one chosen before."""
    everything = AliasConfig(each=5, clusters=3 * COUNT)
    table, position_m = find_aliases(cascade, keys_of(cascade), everything), cascade.templates.position_m
    for template in range(3 * COUNT):
        every = np.arange(3 * COUNT)
        yaw_rad, score = cascade.descriptor.match(
            cascade.templates.described_at(np.array([template])), cascade.templates.described, every
        )
        chosen, spots = [], [(position_m[template].astype(np.float64), 0.0)]
        for row in sorted(every.tolist(), key=lambda row: (-score[row], row)):
            here, yaw = position_m[row].astype(np.float64), float(yaw_rad[row])
            if all(
                np.linalg.norm(here - at) >= SPOT_M
                or math.cos(yaw - other) <= math.cos(math.radians(SPOT_DEG))
                for at, other in spots
            ):
                chosen.append(row)
                spots.append((here, yaw))
        assert table.row[template].tolist() == chosen[:5]
        assert np.allclose(table.score[template] / 255, score[chosen[:5]], rtol=0, atol=0.5 / 255 + 1e-6)


def test_no_template_is_compared_with_more_than_the_clusters_that_are_asked_for(cascade, monkeypatch):
    compared = []
    monkeypatch.setattr(
        Cascade,
        "compare",
        lambda self, described, rows, do=Cascade.compare: (
            compared.append(len(rows)) or do(self, described, rows)
        ),
    )
    find_aliases(cascade, keys_of(cascade), AliasConfig(clusters=10))
    assert compared == [10] * 3 * COUNT


def test_where_there_are_too_many_keys_to_read_all_the_inverted_lists_are_searched(
    cascade, table, monkeypatch
):
    """There is one list of so few keys: the same is found, but for their eight bits."""
    keys, searched = keys_of(cascade), []
    search = build_key_search(keys, SearchConfig(engine="faiss_ivf_sq8"))
    monkeypatch.setattr(
        KeyLists,
        "search",
        lambda self, *given, do=KeyLists.search: searched.append(given[1:]) or do(self, *given),
    )
    monkeypatch.setattr(module, "FLAT_UP_TO", 0)
    again = find_aliases(replace(cascade, keys=search), keys, AliasConfig(each=4, clusters=40))
    assert searched == [(40,)]
    assert_equal(again, table)


def test_the_keys_of_an_engine_that_takes_one_at_a_time_are_all_read(cascade, table, monkeypatch):
    monkeypatch.setattr(module, "FLAT_UP_TO", 0)
    again = find_aliases(cascade, keys_of(cascade), AliasConfig(each=4, clusters=40))
    assert_equal(again, table)


def test_a_map_of_one_place_has_no_aliases(cascade):
    one = cascade.templates
    few = Templates(one.position_m[:1], one.height_m[:1], one.described_at(np.arange(1)))
    keys = build_key_search(cascade.descriptor.keys(few.described), SearchConfig(engine="exhaustive"))
    alone = Cascade(cascade.descriptor, few, TemplateTiles.of(few.position_m), Clusters.alone(1), keys)
    assert (find_aliases(alone, keys_of(alone), AliasConfig()).row == NONE).all()
