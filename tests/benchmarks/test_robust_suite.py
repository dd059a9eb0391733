"""The robust suite on the small world, and its figures on answers whose worth is known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.common.worlds import BenchWorld, Scenery, WorldFiles
from benchmarks.robust.cases import ALL, CASES, CLEAN, Case, Sizes
from benchmarks.robust.figures import calibration_error, figures_of
from benchmarks.robust.outcome import Outcome, ask, nees
from benchmarks.robust.suite import measure
from firstfix.answer.localization import Localization, Verdict
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.transform import make_transform, rotation_z
from small_world import CONFIG, SENSOR, begun_as

SOME = (
    Case("clean", CLEAN),
    Case("all at once", ALL),
    Case("vlp-16 asks", CLEAN, queries="vlp-16"),
    Case("changed", ALL, "changed"),
    Case("outside: a strange yard", ALL, "strange yard"),
    Case("outside: other worlds", ALL, "other worlds"),
)
RIGHT = Outcome("w", "c", True, Verdict.LOCALIZED, 0.95, 2, 0.03, 0.5, 0.4, 0.03, False, 5.0, 10.0)
WRONG = replace(RIGHT, error_m=3.0, error_deg=90.0, yaw_error_deg=90.0, nearest_m=0.1, nees=1e4)
NOT_OURS = replace(WRONG, inside=False, error_m=np.inf, error_deg=np.inf, yaw_error_deg=np.inf, nees=np.nan)


@pytest.fixture(scope="module")
def figures(small_map: Path, small_version, tmp_path_factory: pytest.TempPathFactory):
    def world(name: str, place: str, changed: Scenery | None = None) -> BenchWorld:
        files = WorldFiles(Scenery(small_map), changed)
        return BenchWorld(name, place, CONFIG, lambda cache: files)

    yard = world("yard", "yard", Scenery(small_map))
    absent = replace(yard, name="absent", missing="not here")
    # the same yard under another name: a scan of "elsewhere" that looks right must count as a false accept
    others = (yard, absent, world("other", "elsewhere"))
    folder = tmp_path_factory.mktemp("robust")
    begun_as(small_version, folder / "yard" / SENSOR["name"])
    return measure((yard, absent), SOME, Sizes(6, 4, 3), folder, others)


def test_every_case_has_its_row(figures):
    rows = figures["worlds"]["yard"]["cases"]
    assert list(rows) == [case.name for case in SOME]
    assert [row["n"] for row in rows.values()] == [4, 6, 4, 4, 3, 3]
    assert figures["worlds"]["absent"] == "skipped: not here"


def test_the_yard_is_easy(figures):
    rows = figures["worlds"]["yard"]["cases"]
    assert rows["clean"]["success_0.2m_2deg"] == 1.0
    assert rows["all at once"]["success_0.2m"] >= 0.8
    assert rows["outside: a strange yard"]["false_accepts"] == 0


def test_a_right_looking_scan_from_outside_is_a_false_accept(figures):
    row = figures["worlds"]["yard"]["cases"]["outside: other worlds"]
    assert row["success_0.2m"] is None
    assert row["false_accepts"] == row["verdicts"]["localized"] > 0
    assert figures["total"]["everything"]["false_accepts"] >= row["false_accepts"]


def test_the_same_seed_gives_the_same_scans(figures, small_map, small_version, tmp_path):
    begun_as(small_version, tmp_path / "yard" / SENSOR["name"])
    files = WorldFiles(Scenery(small_map))
    yard = BenchWorld("yard", "yard", CONFIG, lambda cache: files)
    again = measure((yard,), SOME[1:2], Sizes(6, 4, 3), tmp_path, ())["worlds"]["yard"]["cases"][
        "all at once"
    ]
    first = figures["worlds"]["yard"]["cases"]["all at once"]
    assert {**again, "ms": None} == {**first, "ms": None}
    assert "| all at once | 6 |" in (tmp_path / "report.md").read_text()
    assert len((tmp_path / "outcomes.csv").read_text().splitlines()) == 7


def test_cases_have_names_of_their_own():
    assert len({case.name for case in CASES}) == len(CASES)


def test_figures_of_known_answers():
    row = figures_of([RIGHT, RIGHT, WRONG, NOT_OURS])
    assert (row["n"], row["outside"]) == (4, 1)
    assert row["success_0.05m"] == row["success_0.2m_2deg"] == pytest.approx(2 / 3, abs=1e-4)
    assert row["among_all_0.2m"] == 1.0
    assert row["right_localized"] == pytest.approx(2 / 3, abs=1e-4)
    assert row["false_accepts"] == 2
    assert row["ece"] == pytest.approx(0.45)
    assert row["nees_median"] == 5.0


def test_an_alias_is_recognised_when_the_answer_is_not_localized():
    told = replace(WRONG, has_alias=True, verdict=Verdict.AMBIGUOUS)
    guessed, lost = replace(RIGHT, has_alias=True), replace(told, nearest_m=5.0)
    row = figures_of([RIGHT, WRONG, told, guessed, lost])
    assert row["distinct"] == 2
    assert row["distinct_0.2m_2deg"] == 0.5
    assert row["aliases_recognised"] == pytest.approx(1 / 3, abs=1e-4)


def test_a_second_place_just_as_good_is_an_alias(small_version, small_scans):
    localizer, (scan, T) = Localizer(MapIndex.load(small_version.directory)), small_scans[0]
    assert not ask(localizer, scan, T, "w", "c").has_alias
    elsewhere = T @ make_transform(np.eye(3), [3.0, 0, 0])  # were the truth there, the answer would be better
    assert ask(localizer, scan, elsewhere, "w", "c").has_alias


def test_calibration_error_is_zero_for_an_honest_forecaster_and_the_gap_for_another():
    rng = np.random.default_rng(5)
    claimed = rng.uniform(size=20_000)
    assert calibration_error(claimed, rng.uniform(size=20_000) < claimed) < 0.02
    assert calibration_error([0.9, 0.9, 0.2, 1.0], [True, True, False, True]) == pytest.approx(0.1)


def test_nees_of_an_honest_covariance_is_chi_squared():
    rng, found = np.random.default_rng(6), []
    deviation = np.array([0.02, 0.03, 0.01, 0.002, 0.001, 0.004])
    T_true = make_transform(rotation_z(1.0), [5, -2, 1])
    for error in rng.normal(0, deviation, (400, 6)):
        turn = Rotation.from_rotvec(error[3:]).as_matrix()
        T = make_transform(turn @ T_true[:3, :3], T_true[:3, 3] + error[:3])
        answer = Localization(Verdict.LOCALIZED, T_map_sensor=T, covariance=np.diag(deviation**2))
        found.append(nees(T_true, answer))
    assert np.median(found) == pytest.approx(5.35, rel=0.15)
