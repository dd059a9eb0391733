"""Learned keys: where the answer is known, and in a version of more templates than are compared."""

import numpy as np
import pytest

from firstfix.builds.config import BuildConfig, LearnKeysConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.engine.retrieval.cascade import PROJECTION_FILE, load_projection
from firstfix.transform import pose_error
from firstfix_builder.index.learn_keys import discriminants, scans_for
from firstfix_builder.pipeline import build_version
from tests.small_world import COARSE_CONFIG, CONFIG, begun_as

pytestmark = pytest.mark.slow

# What it answers is looked at here, not how surely: a calibration of few queries does.
FEW = {"queries": 4, "outside": 2}
NARROW = {**CONFIG, "engine": {"search": {"clusters": 30}}, "learn_keys": {"scans": 300}, "self_test": FEW}


def test_what_is_learned_lies_where_places_differ_and_perturbations_do_not():
    """Places differ most along x, but perturbations too; along y less, but nothing perturbs it."""
    rng = np.random.default_rng(1)
    places = rng.normal(0, [10.0, 1.0, 0.1], (300, 3)).astype(np.float32)
    within = rng.normal(0, [20.0, 0.02, 0.5], (600, 3)).astype(np.float32)
    learned = discriminants(places, within, 1, 1e-6)[:, 0]
    assert abs(learned[1]) / np.linalg.norm(learned) > 0.99
    largest = np.array([1.0, 0.0, 0.0], np.float32)  # the widest direction of the places
    asked = places + within[:300]

    def found(projection: np.ndarray) -> float:
        away = np.abs((asked @ projection)[:, None] - (places @ projection)[None])
        return float(np.mean(away.argmin(axis=1) == np.arange(300)))

    assert found(learned) > 10 * found(largest) > 0


def test_the_projection_makes_perturbations_alike_in_all_directions():
    rng = np.random.default_rng(2)
    mixed = rng.normal(size=(5, 5)).astype(np.float32)
    within = rng.normal(size=(5000, 5)).astype(np.float32) @ mixed
    projection = discriminants(rng.normal(size=(400, 5)).astype(np.float32), within, 5, 0.0)
    np.testing.assert_allclose(np.cov((within @ projection).T), np.eye(5), atol=0.05)


def test_with_everything_shrunk_the_widest_directions_stay():
    rng = np.random.default_rng(3)
    keys = rng.normal(0, [3.0, 2.0, 1.0], (500, 3)).astype(np.float32)
    projection = discriminants(keys, rng.normal(size=(50, 3)).astype(np.float32), 7, 1.0)
    assert projection.shape == (3, 3)
    assert (np.abs(projection).argmax(axis=0) == [0, 1, 2]).all()


def test_small_maps_learn_from_fewer_scans():
    counts = [scans_for(templates, LearnKeysConfig(scans=800)) for templates in (1, 650, 3200, 100_000)]
    assert counts == [1, 163, 800, 800]


@pytest.fixture(scope="module")
def narrow(small_map, small_version, tmp_path_factory):
    work = begun_as(small_version, tmp_path_factory.mktemp("narrow") / "work")
    return build_version(small_map, BuildConfig.parse(NARROW), work)


def test_a_version_is_searched_by_its_learned_keys(narrow, small_scans):
    projection = load_projection(narrow.directory)
    assert projection is not None
    assert projection.shape == (800, 128)
    assert PROJECTION_FILE in narrow.manifest.files
    localizer = Localizer(MapIndex.load(narrow.directory))
    found = [localizer.localize(scan).hypotheses[0].T_map_sensor for scan, _ in small_scans]
    right = [pose_error(T, at)[0] < 0.1 for at, (_, T) in zip(found, small_scans, strict=True)]
    assert np.mean(right) >= 0.95


def test_learned_twice_is_the_same(coarse_version, small_map, tmp_path):
    assert load_projection(coarse_version.directory) is not None
    again = build_version(small_map, BuildConfig.parse(COARSE_CONFIG), tmp_path / "anew")
    assert again.manifest.digest == coarse_version.manifest.digest


@pytest.mark.parametrize(
    "changes",
    [
        {"learn_keys": {"scans": 0}},
        {"engine": {"search": {"clusters": 100_000}}},
        {"engine": {"method": "paper"}},
    ],
    ids=["not asked for", "all templates are compared", "the paper's keys"],
)
def test_keys_stay_as_they_are_where_nothing_is_to_be_gained(changes, small_map, coarse_work):
    built = build_version(small_map, BuildConfig.parse({**COARSE_CONFIG, **changes}), coarse_work)
    assert load_projection(built.directory) is None
    MapIndex.load(built.directory)
