"""The paper's method and every search engine, chosen in the build config."""

import numpy as np
import pytest

from firstfix.builds.config import BuildConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.transform import pose_error
from firstfix_builder.pipeline import build_version
from tests.small_world import CONFIG

pytestmark = pytest.mark.slow

NO_TEST = {"queries": 0, "outside": 0}


def build(small_map, small_work, engine):
    config = BuildConfig.parse({**CONFIG, "self_test": NO_TEST, "engine": engine})
    return build_version(small_map, config, small_work)


def found(version, scans) -> float:
    """Returns the share of scans whose first hypothesis is right, whatever the verdict."""
    localizer = Localizer(MapIndex.load(version.directory))
    right = 0
    for scan, T_map_sensor in scans:
        hypotheses = localizer.localize(scan).hypotheses
        if hypotheses:
            off_m, off_deg = pose_error(T_map_sensor, hypotheses[0].T_map_sensor)
            right += off_m < 0.1 and off_deg < 1
    return right / len(scans)


def test_the_paper_s_method_is_one_word_of_the_config(small_map, small_work, small_scans):
    version = build(small_map, small_work, {"method": "paper"})
    engine = version.manifest.engine
    assert engine["descriptor"]["kind"] == "pca_sc"
    assert engine["cluster"]["linkage"] == "complete"
    assert engine["search"]["engine"] == "lsh_kdtree"
    assert 0 < version.manifest.counts["clusters"] <= version.manifest.counts["templates"]
    assert found(version, small_scans) >= 0.7  # perturbed scans, K = 10: 17 of 20 when this was written


@pytest.fixture(scope="module")
def found_by_default(small_version, small_scans) -> float:
    """Share of the scans that the default search engine finds."""
    return found(small_version, small_scans)


@pytest.mark.parametrize("engine", ["kdtree", "faiss_ivf_sq8"])
def test_another_search_engine_serves_the_default_method(
    small_map, small_work, small_scans, found_by_default, engine
):
    version = build(small_map, small_work, {"search": {"engine": engine}})
    assert version.manifest.engine["search"]["engine"] == engine
    assert found(version, small_scans) >= found_by_default - 0.05


def test_templates_may_be_clustered_with_the_default_descriptor(small_map, small_work):
    engine = {"cluster": {"threshold": 0.4, "linkage": "average", "neighbours": 8}}
    version = build(small_map, small_work, engine)
    index = MapIndex.load(version.directory)
    members = np.sort(index.cascade.clusters.member)
    assert np.array_equal(members, np.arange(len(index.cascade.templates)))
    assert len(index.cascade.clusters) < len(members)


@pytest.mark.parametrize(
    "engine",
    [
        {"search": {"engine": "annoy"}},
        {"method": "ours"},
        {"descriptor": {"kind": "pca_sc", "rings": 0}},
        {"cluster": {"linkage": "ward"}},
        {"cluster": {"threshold": 1.0}},
    ],
)
def test_what_does_not_exist_is_said_to_be_so(engine):
    from firstfix.errors import InvalidOption

    with pytest.raises(InvalidOption, match="engine"):
        BuildConfig.parse({"engine": engine})
