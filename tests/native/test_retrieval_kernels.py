"""The compiled cascade and its candidates, against the Python cascade, FAISS and NumPy."""

from __future__ import annotations

import pickle
from dataclasses import replace
from functools import cached_property

import faiss
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firstfix import native
from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.engine.config import SearchConfig
from firstfix.engine.retrieval.cascade import Cascade, Clusters, Matches, Templates
from firstfix.engine.retrieval.key_search.faiss_search import FaissSearch
from firstfix.engine.retrieval.key_search.key_codes import KeyCodes
from firstfix.engine.retrieval.template_tiles import TemplateTiles
from firstfix.transform import make_transform
from tests.reference.candidates import candidates_of

DESCRIPTOR = LayeredOccupancy(PolarGrid(6, 60, 20.0), (0.3, 1.0, 2.0), 5)


class PythonCascade(Cascade):
    """A cascade whose steps are FAISS' and NumPy's."""

    @cached_property
    def compiled(self) -> None:
        return None


def make_cascade(rng: np.random.Generator, count: int, *, projected: bool, clustered: bool) -> Cascade:
    occupancy = np.packbits(
        rng.random((count, DESCRIPTOR.rows * 60)) < rng.uniform(0.05, 0.5, (count, 1)), axis=1
    )
    position_m = rng.uniform(-30, 30, (count, 3)).astype(np.float32)
    templates = Templates(position_m, rng.uniform(0.5, 2, count).astype(np.float32), {"occupancy": occupancy})
    clusters = Clusters.alone(count)
    if clustered:
        clusters = Clusters.from_labels(np.arange(count) // 3, lambda group: len(group) - 1)
    keys = DESCRIPTOR.keys({"occupancy": occupancy[clusters.representative]})
    projection = rng.normal(size=(keys.shape[1], 37)).astype(np.float32) if projected else None
    keys = keys if projection is None else keys @ projection
    search = FaissSearch.build(keys, SearchConfig(engine="faiss_sq8"))
    return Cascade(DESCRIPTOR, templates, TemplateTiles.of(position_m), clusters, search, projection)


def in_python(cascade: Cascade) -> PythonCascade:
    parts = cascade.descriptor, cascade.templates, cascade.tiles, cascade.clusters, cascade.keys
    return PythonCascade(*parts, cascade.projection)


def assert_same(found: Matches, expected: Matches) -> None:
    np.testing.assert_array_equal(found.rows, expected.rows)
    np.testing.assert_array_equal(found.yaw_rad, expected.yaw_rad)
    np.testing.assert_array_equal(found.score, expected.score)


@given(st.integers(0, 1000), st.integers(1, 90), st.booleans(), st.booleans(), st.integers(1, 40))
@settings(max_examples=40, deadline=None)
def test_the_cascade_is_that_of_faiss_and_numpy(
    seed: int, count: int, projected: bool, clustered: bool, most: int
):
    rng = np.random.default_rng(seed)
    cascade = make_cascade(rng, count, projected=projected, clustered=clustered)
    python = in_python(cascade)
    query = {"occupancy": np.packbits(rng.random((1, DESCRIPTOR.rows * 60)) < 0.3, axis=1)}
    assert_same(cascade.search(query, most), python.search(query, most))
    centre, radius_m = rng.uniform(-30, 30, 3), rng.uniform(1, 60)
    assert_same(
        cascade.search_near(query, centre, radius_m, most), python.search_near(query, centre, radius_m, most)
    )


@given(st.integers(0, 1000), st.integers(1, 300), st.integers(1, 140))
@settings(max_examples=40, deadline=None)
def test_codes_stand_for_the_keys_that_faiss_decodes(seed: int, count: int, numbers: int):
    rng = np.random.default_rng(seed)
    index = faiss.IndexScalarQuantizer(numbers, faiss.ScalarQuantizer.QT_8bit, faiss.METRIC_L2)
    keys = rng.normal(size=(count, numbers)).astype(np.float32)
    index.train(keys)
    index.add(keys)
    codes = KeyCodes.of(index)
    assert codes is not None
    decoded = codes.lowest + (codes.codes + np.float32(0.5)) / np.float32(255) * codes.range
    np.testing.assert_allclose(decoded, index.reconstruct_n(0, count), atol=1e-6)


def test_a_search_of_another_kind_has_no_codes():
    keys = np.random.default_rng(3).normal(size=(200, 8)).astype(np.float32)
    search = FaissSearch.build(keys, SearchConfig(engine="faiss_ivf_sq8"))
    assert search.codes() is None
    position_m = np.random.default_rng(4).uniform(-500, 500, (200, 3)).astype(np.float32)
    sharded = FaissSearch.build(keys, SearchConfig(engine="faiss_sq8", shard_keys=100), position_m)
    assert sharded.codes() is None


@given(st.integers(0, 1000), st.integers(0, 60), st.booleans(), st.booleans(), st.integers(1, 30))
@settings(max_examples=60, deadline=None)
def test_candidates_are_those_of_numpy(seed: int, count: int, has_prior: bool, has_spots: bool, most: int):
    rng = np.random.default_rng(seed)
    position_m = rng.uniform(-6, 6, (70, 3)).astype(np.float32)
    templates = Templates(position_m, rng.uniform(0.5, 2, 70).astype(np.float32), {})
    matches = Matches(
        rng.integers(0, 70, count),
        rng.integers(0, 60, count) * (2 * np.pi / 60),
        rng.random(count).astype(np.float32),
    )
    R_level_sensor = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    T_scan_last = make_transform(np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.normal(size=3))
    T_map_level = make_transform(np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.normal(size=3))
    headings = (
        (T_map_level, float(rng.uniform(-180, 180)), float(rng.uniform(10, 190))) if has_prior else None
    )
    spot = (2.0, float(np.cos(0.3)), 2) if has_spots else None
    how = headings, most, spot
    rows, poses, score = native.candidates_of(
        *(matches.rows, matches.yaw_rad, matches.score, templates.position_m, templates.height_m),
        *(R_level_sensor, 1.3, T_scan_last, *how),
    )
    expected = candidates_of(matches, templates, (R_level_sensor, 1.3, T_scan_last), *how)
    assert rows.tolist() == expected[0]
    np.testing.assert_allclose(poses, expected[1], atol=1e-12)
    assert score.tolist() == expected[2]


def test_a_cascade_goes_to_another_process():
    cascade = make_cascade(np.random.default_rng(7), 30, projected=True, clustered=False)
    query = {"occupancy": cascade.templates.described["occupancy"][:1]}
    expected = cascade.search(query, 5)
    assert_same(pickle.loads(pickle.dumps(cascade)).search(query, 5), expected)


def test_tables_that_do_not_fit_are_refused():
    cascade = make_cascade(np.random.default_rng(5), 30, projected=False, clustered=True)
    query = {"occupancy": cascade.templates.described["occupancy"][:1]}
    clusters, tiles = cascade.clusters, cascade.tiles
    beyond, before = clusters.member.copy(), tiles.row.copy()
    beyond[4], before[2] = 30, -1
    for wrong, message in (
        (replace(cascade, clusters=replace(clusters, member=beyond)), "no such member"),
        (
            replace(cascade, clusters=replace(clusters, start=clusters.start[::-1].copy())),
            "every template once",
        ),
        (replace(cascade, tiles=replace(tiles, row=before)), "no such template"),
        (replace(cascade, tiles=replace(tiles, begin=tiles.begin + 1)), "outside of the templates"),
        (replace(cascade, projection=np.ones((4, 8), np.float32)), "projection does not fit"),
    ):
        with pytest.raises(ValueError, match=message):
            wrong.search(query, 3)
