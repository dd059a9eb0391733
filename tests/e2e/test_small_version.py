"""From a mesh file to poses, through the real build and the real query flow."""

import dataclasses
import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.options import MAX_NUMBER, LocalizeOptions
from firstfix.builds.config import PerturbConfig
from firstfix.engine.false_accept_bound import FalseAcceptBound
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer, localize_among
from firstfix.engine.ranking import RankingConfig
from firstfix.errors import CorruptVersion, InvalidOption
from firstfix.scan.condense import describe
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import inverse, make_transform, pose_error, rotation_z
from firstfix_builder.self_test.taught_outcomes import taught_outcomes
from firstfix_builder.self_test.threshold import FLOOR
from firstfix_builder.simulation.perturb import elsewhere, perturbed_scans
from firstfix_builder.simulation.simulate import Simulator
from tests.small_world import SENSOR


def test_a_built_version_is_complete(small_version):
    small_version.manifest.verify_directory(small_version.directory)
    assert small_version.manifest.counts["templates"] > 50
    assert small_version.manifest.self_test["queries"] == 40
    assert small_version.manifest.self_test["false_accepts"] == 0
    json.dumps(small_version.manifest.to_mapping())


def test_a_bound_on_false_accepts_is_measured_and_asked_for(small_version, localizer, small_scans):
    found = localizer.index.false_accept_bound
    told = small_version.manifest.self_test
    assert told["false_accept_bound"] == found.to_mapping()
    assert found.negatives >= told["outside"]
    assert 0 < found.least < 0.5
    scan = small_scans[2][0]
    lax = localizer.localize(scan, LocalizeOptions(max_false_accept=1.0))
    assert lax.verdict is Verdict.LOCALIZED
    by_threshold = LocalizeOptions(min_probability=found.min_probability(found.least))
    by_promise = LocalizeOptions(max_false_accept=found.least)
    for one, _ in small_scans[:8]:
        assert localizer.localize(one, by_promise).verdict is localizer.localize(one, by_threshold).verdict
    with pytest.raises(InvalidOption, match=str(found.least)):
        localizer.localize(scan, LocalizeOptions(max_false_accept=found.least / 2))


def test_the_threshold_is_chosen_by_the_self_test_and_reported(small_version, localizer):
    told = small_version.manifest.self_test["threshold"]
    calibration = localizer.index.calibration
    assert calibration.min_probability == told["min_probability"] >= FLOOR
    assert told["max_false_accept"] == 0.005
    assert [other["max_false_accept"] for other in told["others"]] == [0.01, 0.005, 0.001]
    shares = [other["localized"] for other in told["others"]]
    assert shares == sorted(shares, reverse=True)
    more = {"others": told["others"], "taught": taught_outcomes().to_mapping()}
    assert told == {**told["others"][1], **more}


def test_a_bound_on_false_accepts_must_hold_for_each_map(localizer, small_scans):
    strict = Localizer(
        dataclasses.replace(localizer.index, false_accept_bound=FalseAcceptBound.of([-1.0] * 5000))
    )
    asked = LocalizeOptions(max_false_accept=strict.index.false_accept_bound.least)
    scan = small_scans[2][0]
    assert localize_among({"yard": strict}, scan, asked).map_id == "yard"
    with pytest.raises(InvalidOption, match="map hall"):
        localize_among({"yard": strict, "hall": localizer}, scan, asked)


def test_perturbed_scans_between_the_templates_get_their_pose(localizer, small_scans):
    # 40 scans calibrate a version coarsely: how many good fits reach its threshold is their seed's chance
    asked = LocalizeOptions(min_probability=0.9)
    answers = [localizer.localize(scan, asked) for scan, _ in small_scans]
    errors = [
        pose_error(T, answer.hypotheses[0].T_map_sensor)
        for answer, (_, T) in zip(answers, small_scans, strict=True)
    ]
    within = [error_m < 0.05 and error_deg < 0.5 for error_m, error_deg in errors]
    assert np.mean(within) >= 0.95, errors
    accepted = [a for a in answers if a.verdict is Verdict.LOCALIZED]
    assert len(accepted) >= 0.8 * len(answers)
    assert all(
        error_m < 0.2
        for answer, (error_m, _) in zip(answers, errors, strict=True)
        if answer.verdict is Verdict.LOCALIZED
    )


def test_a_leaning_sensor_is_localized(localizer, small_scans):
    lean = Rotation.from_euler("XY", [11, -9], degrees=True).as_matrix()
    for scan, T in small_scans[:6]:
        leaning = Scan.from_points(scan.points @ lean.T)
        expected = T @ make_transform(lean.T, [0, 0, 0])
        error_m, error_deg = pose_error(expected, localizer.localize(leaning).hypotheses[0].T_map_sensor)
        assert error_m < 0.1
        assert error_deg < 1.0


def test_a_given_gravity_is_used(localizer, small_scans):
    scan, T = small_scans[0]
    down = T[:3, :3].T @ [0, 0, -1.0]
    answer = localizer.localize(scan, LocalizeOptions(gravity=down))
    assert pose_error(T, answer.hypotheses[0].T_map_sensor)[0] < 0.05


@pytest.mark.parametrize("ahead_m", [0.2, MAX_NUMBER])
def test_base_pose_follows_from_the_mounting(localizer, small_scans, ahead_m):
    T_base_sensor = make_transform(rotation_z(0.3), [ahead_m, 0, 0.6])
    answer = localizer.localize(small_scans[1][0], LocalizeOptions(T_base_sensor=T_base_sensor))
    assert answer.verdict is Verdict.LOCALIZED
    assert np.allclose(answer.T_map_base, answer.T_map_sensor @ inverse(T_base_sensor))


def test_scans_of_another_place_get_no_pose(localizer):
    rng = np.random.default_rng(5)
    spots = np.column_stack([rng.uniform(-12, 12, (50, 2)), np.full(50, 0.8)])
    foreign = perturbed_scans(
        Simulator(*elsewhere(rng)), SensorModel.from_mapping(SENSOR), spots, 1.0, 12, PerturbConfig(), rng
    )
    assert len(foreign) == 12
    for scan, _ in foreign:
        answer = localizer.localize(scan)
        assert answer.verdict is not Verdict.LOCALIZED
        assert answer.T_map_sensor is None
        assert answer.covariance is None
        assert answer.reasons


def test_one_flat_wall_is_not_localized(localizer):
    y, z = np.meshgrid(np.linspace(-10, 10, 200), np.linspace(-1, 2, 40))
    wall = np.column_stack([np.full(y.size, 4.0), y.ravel(), z.ravel()])
    assert localizer.localize(Scan.from_points(wall)).verdict is not Verdict.LOCALIZED


def test_the_covariance_is_valid_and_not_too_small(localizer, small_scans):
    squared = []
    for scan, T in small_scans:
        answer = localizer.localize(scan)
        if answer.covariance is None:
            continue
        assert np.allclose(answer.covariance, answer.covariance.T)
        assert np.linalg.eigvalsh(answer.covariance).min() > 0
        off = answer.T_map_sensor[:3, 3] - T[:3, 3]
        squared.append(off @ np.linalg.solve(answer.covariance[:3, :3], off) / 3)
    assert np.mean(squared) < 2.0


def test_answers_are_encoded_without_loss(localizer, small_scans):
    answer = localizer.localize(small_scans[1][0])
    back = Localization.from_mapping(json.loads(json.dumps(answer.to_mapping())))
    assert back.verdict is answer.verdict
    assert np.allclose(back.T_map_sensor, answer.T_map_sensor, atol=1e-12)
    assert np.allclose(back.covariance, answer.covariance)
    assert len(back.hypotheses) == len(answer.hypotheses)


def test_only_localized_answers_may_have_a_pose(localizer, small_scans):
    answer = localizer.localize(small_scans[1][0])
    with pytest.raises(ValueError, match="has a pose"):
        dataclasses.replace(answer, verdict=Verdict.REJECTED)


@pytest.mark.parametrize(
    "name",
    [
        "engine.json",
        "keys.faiss",
        "surface_fine.safetensors",
        "surface_coarse.safetensors",
        "view_near.safetensors",
        "view_far.safetensors",
        "template_occupancy.npy",
        "cluster_start.npy",
        "calibration.json",
    ],
)
def test_a_missing_file_is_a_corrupt_version(small_version, tmp_path, name):
    for path in small_version.directory.iterdir():
        if path.name != name:
            (tmp_path / path.name).symlink_to(path)
    with pytest.raises(CorruptVersion):
        MapIndex.load(tmp_path)


def test_answers_read_every_number_of_the_versions_ranking(localizer, small_scans):
    read: set[str] = set()

    class Noted(RankingConfig):
        def __getattribute__(self, name: str) -> object:
            read.add(name)
            return super().__getattribute__(name)

    index = localizer.index
    noted = Noted(**index.config.ranking.model_dump())
    config = index.config.model_copy(update={"ranking": noted})
    surface = dataclasses.replace(index.surface, ranking=noted)
    asked = Localizer(dataclasses.replace(index, config=config, surface=surface))
    scan = small_scans[2][0]
    sweep_s = np.linspace(-0.1, 0, len(scan.points)).astype(np.float32)
    asked.localize(dataclasses.replace(scan, time_s=sweep_s))  # a motion
    localize_among({"one": asked, "two": asked}, scan)  # places that tie
    asked.localize(Scan.from_points(scan.points * [1, 1.4, 0.8]))  # a hard scan
    asked.localize(describe(scan, DescriptorParameters.from_engine(index.config.model_dump())))
    assert not set(RankingConfig.model_fields) - read
