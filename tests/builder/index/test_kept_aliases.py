"""Known aliases that are kept: nearly those that a search of all templates finds, where some have changed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from firstfix.engine.config import AliasConfig, SearchConfig
from firstfix.engine.retrieval.alias_table import NONE
from firstfix.engine.retrieval.cascade import Cascade, Clusters, Templates
from firstfix.engine.retrieval.key_search import build_key_search
from firstfix.engine.retrieval.template_tiles import TemplateTiles
from firstfix_builder.index.find_aliases import find_aliases
from firstfix_builder.index.kept_aliases import KeptAliases
from tests.builder.index.test_find_aliases import COUNT, corridors, keys_of

CONFIG = AliasConfig(each=4, clusters=40)


def of_templates(before: Cascade, templates: Templates) -> Cascade:
    keys = build_key_search(before.descriptor.keys(templates.described), SearchConfig(engine="exhaustive"))
    tiles, alone = TemplateTiles.of(templates.position_m), Clusters.alone(len(templates))
    return replace(before, templates=templates, tiles=tiles, clusters=alone, keys=keys)


@pytest.fixture(scope="module")
def before() -> Cascade:
    return corridors()


@pytest.fixture(scope="module")
def now(before: Cascade) -> tuple[Cascade, np.ndarray]:
    """Templates in another order; ten that were like none are now like the first corridor; five are gone."""
    templates = before.templates
    occupancy = templates.described["occupancy"].copy()
    changed = np.arange(2 * COUNT, 2 * COUNT + 10)
    occupancy[changed] = occupancy[:10]
    order = np.random.default_rng(1).permutation(len(templates))
    order = order[~np.isin(order, np.arange(COUNT, COUNT + 5))]
    moved = Templates(templates.position_m[order], templates.height_m[order], {"occupancy": occupancy[order]})
    return of_templates(before, moved), np.where(np.isin(order, changed), -1, order)


def test_they_are_nearly_those_of_a_search_of_all(before: Cascade, now: tuple[Cascade, np.ndarray]):
    cascade, row_before = now
    kept = KeptAliases(find_aliases(before, keys_of(before), CONFIG), row_before)
    found = kept.renewed(cascade, keys_of(cascade), CONFIG)
    anew = find_aliases(cascade, keys_of(cascade), CONFIG)
    assert (found.score[:, 0] == anew.score[:, 0]).mean() > 0.95, "the most similar place elsewhere"
    known = [
        len(np.intersect1d(one[one != NONE], other)) for one, other in zip(found.row, anew.row, strict=True)
    ]
    assert np.sum(known) / (anew.row != NONE).sum() > 0.8
    changed = row_before < 0
    assert (found.row[changed] == anew.row[changed]).all()
    (first,) = np.flatnonzero(row_before == 3)
    assert cascade.templates.position_m[found.row[first, 0], 1] == -60, "it looks like a changed one now"
    assert abs(int(found.turn[first, 0])) == 0


def test_where_nothing_has_changed_they_are_the_same(before: Cascade):
    table = find_aliases(before, keys_of(before), CONFIG)
    same = KeptAliases(table, np.arange(len(before.templates))).renewed(before, keys_of(before), CONFIG)
    assert all(np.array_equal(vars(same)[name], array) for name, array in vars(table).items())


def test_an_alias_that_is_gone_or_has_changed_is_no_alias(before: Cascade):
    table = find_aliases(before, keys_of(before), CONFIG)
    row_before = np.arange(len(before.templates))
    row_before[COUNT : 2 * COUNT] = -1
    moved = KeptAliases(table, row_before)._moved(CONFIG.each)
    assert (moved.row[COUNT : 2 * COUNT] == NONE).all()
    assert not np.isin(moved.row, np.arange(COUNT, 2 * COUNT)).any()
    assert ((moved.row[:, :-1] == NONE) <= (moved.row[:, 1:] == NONE)).all(), "no gap before the last"
