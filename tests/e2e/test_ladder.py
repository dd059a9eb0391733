"""The compiled ladder of effort answers as the one in Python does, to the last bit."""

import time
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer, localize_among
from firstfix.engine.map_search import MapSearch, Step
from firstfix.engine.retrieval.cascade import Matches
from firstfix.scan.condense import condense, describe
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import make_transform
from tests.python_cascade import PythonCascade, searched_by
from tests.reference.map_search import LocalizerInSteps
from tests.storey_world import ROOMS_X, pose, scan_at, storey, storey_version

HEAD_DOWN = np.diag([1.0, -1.0, -1.0])
TWIST = np.array([0.8, 0.1, 0.0, 0.0, 0.02, 0.4])
ALL = [Step.NARROW, Step.WIDE, Step.OTHER_UPS, Step.EXHAUSTIVE]


def parts(value: object) -> object:
    """A value whose parts can be compared: arrays by their bytes, NaN equal to itself."""
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    if isinstance(value, float):
        return value.hex()
    if isinstance(value, tuple | list):
        return [parts(one) for one in value]
    if is_dataclass(value):
        return {field.name: parts(getattr(value, field.name)) for field in fields(value)}
    return value


def assert_equal(answer: Localization, wanted: Localization) -> None:
    assert list(answer.timings_ms) == list(wanted.timings_ms)
    assert parts(replace(answer, timings_ms={})) == parts(replace(wanted, timings_ms={}))


def turned(scan: Scan, R: np.ndarray) -> Scan:
    return Scan.from_points(scan.points @ R)


def of_one_side(scan: Scan) -> Scan:
    azimuth = np.arctan2(scan.points[:, 1], scan.points[:, 0])
    return Scan.from_points(scan.points[np.abs(azimuth) < 0.9])


def in_time(scan: Scan) -> Scan:
    azimuth = np.arctan2(scan.points[:, 1], scan.points[:, 0])
    return replace(scan, time_s=(-0.1 * (0.5 - azimuth / (2 * np.pi))).astype(np.float32))


def noise(seed: int) -> Scan:
    return Scan.from_points(np.random.default_rng(seed).normal(0, 4, (3000, 3)).astype(np.float32))


@pytest.fixture(scope="module")
def forms(small_scans, parameters):
    """Scans of many kinds, easy and hard, by name."""
    (first, T_first), (second, T_second) = small_scans[:2]
    compact = condense(first)
    described = replace(compact, described=describe(first, parameters))
    return {
        **{f"scan {number}": scan for number, (scan, _) in enumerate(small_scans[:6])},
        "head down": turned(first, HEAD_DOWN),
        "one side": of_one_side(second),
        "in time": in_time(first),
        "noise": noise(3),
        "compact": compact,
        "compact, described": described,
        "sequence": ScanSequence.along([first, second], [T_first, T_second]),
        "sequence, head down": ScanSequence.along([turned(first, HEAD_DOWN)] * 2, [np.eye(4)] * 2),
    }


@pytest.mark.parametrize("retrieval", ["compiled", "in Python"])
def test_every_scan_is_answered_as_in_steps(index, forms, retrieval):
    asked = index if retrieval == "compiled" else searched_by(index)
    verdicts = set()
    for scan in forms.values():
        answer = Localizer(asked).localize(scan)
        assert_equal(answer, LocalizerInSteps(index).localize(scan))
        verdicts.add(answer.verdict)
    assert len(verdicts) > 1


def options_of(T_map_sensor: np.ndarray) -> dict[str, LocalizeOptions]:
    """Options of a scan whose pose is known, by name."""
    here, away = T_map_sensor[:3, 3], T_map_sensor[:3, 3] + [6.0, 0, 0]
    tilted = make_transform([[1, 0, 0], [0, 0, -1], [0, 1, 0]], [0.1, 0, 0.4])
    return {
        "prior": LocalizeOptions(prior=Prior(here, 2.0)),
        "prior with heading": LocalizeOptions(prior=Prior(here, 30.0, 90.0, 60.0)),
        "wrong prior": LocalizeOptions(prior=Prior(away, 2.5)),
        "candidates": LocalizeOptions(max_candidates=3),
        "gravity": LocalizeOptions(gravity=np.array([0.3, 0.1, -9.7])),
        "mounting": LocalizeOptions(T_base_sensor=tilted),
        "threshold": LocalizeOptions(min_probability=0.2),
        "no time": LocalizeOptions(deadline_ms=1),
    }


@pytest.mark.parametrize("retrieval", ["compiled", "in Python"])
def test_every_option_is_answered_as_in_steps(index, small_scans, retrieval):
    asked = index if retrieval == "compiled" else searched_by(index)
    for scan, T_map_sensor in small_scans[:2]:
        for options in options_of(T_map_sensor).values():
            for form in (scan, turned(scan, HEAD_DOWN)):
                answer = Localizer(asked).localize(form, options)
                assert_equal(answer, LocalizerInSteps(index).localize(form, options))


def test_a_motion_is_answered_as_in_steps(index, small_scans):
    scan, options = in_time(small_scans[0][0]), LocalizeOptions(twist=TWIST)
    assert_equal(Localizer(index).localize(scan, options), LocalizerInSteps(index).localize(scan, options))


@pytest.fixture(scope="module")
def storey_index(once_a_run):
    return MapIndex.load(storey_version(once_a_run).directory)


@pytest.mark.parametrize("likely_one", [False, True])
def test_several_maps_are_answered_as_in_steps(index, storey_index, forms, likely_one):
    for name in ("scan 0", "head down", "noise", "sequence"):
        for several in ((index, storey_index), (storey_index, index, searched_by(index))):
            numbered = list(enumerate(several))
            maps = {str(n): Localizer(one) for n, one in numbered}
            in_steps = {str(n): LocalizerInSteps(one) for n, one in numbered}
            answer = localize_among(maps, forms[name], likely_one=likely_one)
            assert_equal(answer, localize_among(in_steps, forms[name], likely_one=likely_one))


def test_aliases_and_places_outside_a_prior_are_answered_as_in_steps(storey_index):
    world, verdicts = storey(), set()
    for number, (x, y, yaw_deg) in enumerate(
        [(ROOMS_X[0], 0.3, 40), (ROOMS_X[1], 2.4, -90), (11.0, 3.7, 20)]
    ):
        scan, T_map_sensor = scan_at(world, pose(x, y, yaw_deg), 4 + number), pose(x, y, yaw_deg)
        wrong = pose(ROOMS_X[1] - ROOMS_X[0] + x, y, yaw_deg)
        for options in (
            LocalizeOptions(),
            LocalizeOptions(prior=Prior(T_map_sensor[:3, 3], 2.0)),
            LocalizeOptions(prior=Prior(wrong[:3, 3], 2.0)),
        ):
            answer = Localizer(storey_index).localize(scan, options)
            assert_equal(answer, LocalizerInSteps(storey_index).localize(scan, options))
            verdicts.add(answer.verdict)
    assert verdicts == set(Verdict)


class NotingLocalizer(Localizer):
    """A localizer that keeps its searches."""

    def __init__(self, index: MapIndex) -> None:
        super().__init__(index, explains=False)
        self.searches: list[MapSearch] = []

    def search(self, *given, **named) -> MapSearch:
        self.searches.append(super().search(*given, **named))
        return self.searches[-1]

    @property
    def taken(self) -> list[Step]:
        """Of the last search."""
        return self.searches[-1].taken


def finding_by(index: MapIndex, right: Step | None) -> NotingLocalizer:
    """A localizer whose search finds the right templates in one step alone."""
    asked: list[int] = []
    clusters = index.config.search.clusters

    class LateCascade(PythonCascade):
        def search(self, described, of: int) -> Matches:
            found = super().search(described, of)
            asked.append(of)
            others = asked.count(clusters) > 1  # the first step has one search
            step = (
                [Step.WIDE, Step.EXHAUSTIVE][others]
                if of != clusters
                else [Step.NARROW, Step.OTHER_UPS][others]
            )
            least = slice(None) if step is right else slice(-1, None)
            return Matches(found.rows[least], found.yaw_rad[least], found.score[least])

    return NotingLocalizer(searched_by(index, LateCascade))


@pytest.mark.parametrize("number", range(4))
def test_the_search_ends_at_the_level_that_finds_the_place(index, small_scans, number):
    scan = small_scans[0][0]
    localizer = finding_by(index, ALL[number])
    answer = localizer.localize(turned(scan, HEAD_DOWN) if ALL[number] is Step.OTHER_UPS else scan)
    assert answer.verdict is Verdict.LOCALIZED
    assert localizer.taken == ALL[: number + 1]


def test_a_localized_place_ends_the_search_by_the_maps_own_threshold(index, small_scans):
    """Many maps may have taught a lower threshold: what is searched for less is less often right."""
    scan = small_scans[0][0]
    for search_until, steps in ((0.5, [Step.NARROW]), (1.0, [Step.NARROW, Step.WIDE])):
        calibration = replace(index.calibration, search_until=search_until)
        localizer = NotingLocalizer(replace(index, calibration=calibration))
        localizer.localize(scan)
        assert localizer.taken[:2] == steps


def test_a_scan_of_another_place_takes_every_step_once(index):
    localizer = NotingLocalizer(index)
    localizer.localize(noise(1))
    assert localizer.taken == ALL


def test_a_map_that_explains_the_scan_ends_the_search_of_others(index, small_scans):
    found, other = finding_by(index, Step.WIDE), finding_by(index, None)
    localize_among({"found": found, "other": other}, small_scans[0][0], explains=False)
    assert found.taken == other.taken == [Step.NARROW, Step.WIDE]


def test_limited_candidates_are_not_extended(index):
    localizer = NotingLocalizer(index)
    localizer.localize(noise(1), LocalizeOptions(max_candidates=5))
    assert localizer.taken == [Step.NARROW, Step.OTHER_UPS]


@pytest.mark.parametrize(("left_s", "steps"), [(-1.0, [Step.NARROW]), (0.0, [Step.NARROW]), (1e6, ALL)])
def test_a_step_begins_only_if_the_deadline_leaves_time_for_it(index, left_s, steps):
    localizer = NotingLocalizer(index)
    answer = localizer.localize(noise(1), deadline=time.monotonic() + left_s)
    assert localizer.taken == steps, "there is always an answer"
    assert "search" in answer.timings_ms


def test_an_error_of_a_retrieval_in_python_is_the_querys(index, small_scans):
    class Broken(PythonCascade):
        def search(self, described, clusters: int) -> Matches:
            raise OSError("the shard is gone")

    class Damaged(PythonCascade):
        def search(self, described, clusters: int) -> Matches:
            found = super().search(described, clusters)
            return Matches(found.rows + len(self.templates), found.yaw_rad, found.score)

    with pytest.raises(OSError, match="the shard is gone"):
        Localizer(searched_by(index, Broken)).localize(small_scans[0][0])
    with pytest.raises(ValueError, match="row of a template"):
        Localizer(searched_by(index, Damaged)).localize(small_scans[0][0])
