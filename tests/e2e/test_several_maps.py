"""One scan in several maps: the right map answers; two maps that look alike are ambiguous."""

import numpy as np
import pytest

from firstfix.answer.localization import Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.builds.config import BuildConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer, localize_among
from firstfix.errors import InvalidOption
from firstfix.transform import pose_error
from firstfix_builder.pipeline import build_version
from tests.small_world import CONFIG, SmallWorld


@pytest.fixture(scope="module")
def yard(small_version):
    return Localizer(MapIndex.load(small_version.directory))


@pytest.fixture(scope="module")
def mirrored(small_world, tmp_path_factory):
    """Localizer in the mirrored yard: it looks alike, but no rotation fits."""
    folder = tmp_path_factory.mktemp("mirrored")
    world = SmallWorld(small_world.vertices * [1, -1, 1], small_world.triangles[:, ::-1])
    config = BuildConfig.parse({**CONFIG, "self_test": {"queries": 12, "outside": 6}})
    version = build_version(world.write(folder / "m.ply"), config, folder / "work")
    return Localizer(MapIndex.load(version.directory))


def test_the_map_of_the_scan_answers(yard, mirrored, small_scans):
    maps = {"mirrored": mirrored, "yard": yard}
    for scan, T_map_sensor in small_scans[:8]:
        alone = yard.localize(scan)
        answer = localize_among(maps, scan)
        if alone.hypotheses and pose_error(T_map_sensor, alone.hypotheses[0].T_map_sensor)[0] < 0.1:
            assert answer.hypotheses[0].map_id == "yard"
            assert pose_error(T_map_sensor, answer.hypotheses[0].T_map_sensor)[0] < 0.1
        if answer.verdict is Verdict.LOCALIZED:
            assert answer.map_id == "yard"


def test_two_maps_of_one_place_are_ambiguous(yard, small_scans):
    for scan, _ in small_scans[:8]:
        answer = localize_among({"first": yard, "second": yard}, scan)
        assert answer.verdict is not Verdict.LOCALIZED
        assert {h.map_id for h in answer.hypotheses[:2]} == {"first", "second"}
        assert answer.hypotheses[0].quality == answer.hypotheses[1].quality


def test_a_prior_belongs_to_one_map(yard, small_scans):
    options = LocalizeOptions(prior=Prior(np.zeros(3), 2.0))
    with pytest.raises(InvalidOption, match="one map"):
        localize_among({"first": yard, "second": yard}, small_scans[0][0], options)
