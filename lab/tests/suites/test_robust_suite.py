"""The robust suite on the small world, and its figures on answers whose worth is known."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.quality import AlignmentQuality
from firstfix.engine.false_accept_bound import upper_bound
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.transform import make_transform, rotation_z
from firstfix_lab.common.nees import nees_by_class
from firstfix_lab.common.worlds import WORLDS, BenchWorld, Scenery, WorldFiles
from firstfix_lab.suites.robust import suite
from firstfix_lab.suites.robust.cases import ALL, ANY, CASES, CLEAN, OTHER, SENSORS, Case, Sizes
from firstfix_lab.suites.robust.figures import LOOK_ALIKES, bars_of, calibration_error, figures_of
from firstfix_lab.suites.robust.outcome import Outcome, Standing, ask, nees, standing_of
from firstfix_lab.suites.robust.parts import Part, read_outcomes, write_outcomes
from firstfix_lab.suites.robust.sensors import asking_sensors, template_sensor
from firstfix_lab.suites.robust.suite import measure, measure_world
from tests.small_world import CONFIG, SENSOR, begun_as

SOME = (
    Case("clean", CLEAN),
    Case("all at once", ALL),
    Case("vlp-16 asks", CLEAN, queries="vlp-16"),
    Case("any sensor asks", CLEAN, queries=ANY, own_height=True),
    Case("changed", ALL, "changed"),
    Case("outside: a strange yard", ALL, "strange yard"),
    Case("outside: other worlds", ALL, "other worlds"),
)
RIGHT = Outcome(
    "w",
    "c",
    "t",
    "s",
    True,
    Verdict.LOCALIZED,
    0.95,
    2,
    0.03,
    0.5,
    0.4,
    0.03,
    Standing.DISTINCT,
    5.0,
    10.0,
)
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
    assert [row["n"] for row in rows.values()] == [4, 6, 4, 4, 4, 3, 3]
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


def test_many_sensors_ask(figures):
    asked = {name for name, row in figures["sensors"].items() if name != SENSOR["name"] and row["answers"]}
    assert len(asked) >= 4
    assert all(name.endswith(f"asks {SENSOR['name']}") for name in figures["pairs"])
    assert figures["worlds"]["yard"]["cases"]["any sensor asks"]["success_0.2m"] >= 0.75


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
    assert len(read_outcomes(tmp_path / "outcomes.csv")) == 6
    assert "| all worlds | 6 |" in (tmp_path / "report.md").read_text()


def test_cases_have_names_of_their_own():
    assert len({case.name for case in CASES}) == len(CASES)


def test_figures_of_known_answers():
    row = figures_of([RIGHT, RIGHT, WRONG, NOT_OURS])
    assert row["wrong_0.2m"] == 2
    beside = replace(RIGHT, error_m=0.3)
    assert figures_of([beside, replace(beside, verdict=Verdict.AMBIGUOUS)])["wrong_0.2m"] == 1
    assert (row["n"], row["outside"]) == (4, 1)
    assert row["success_0.05m"] == row["success_0.2m_2deg"] == pytest.approx(2 / 3, abs=1e-4)
    assert row["among_all_0.2m"] == 1.0
    assert row["right_localized"] == pytest.approx(2 / 3, abs=1e-4)
    assert row["false_accepts"] == 2
    assert row["ece"] == pytest.approx(0.45)
    assert row["nees_median"] == 5.0


def test_an_alias_is_recognised_when_the_answer_is_not_localized():
    recognised = replace(WRONG, standing=Standing.ALIAS, verdict=Verdict.AMBIGUOUS)
    guessed, lost = replace(RIGHT, standing=Standing.OUTSHONE), replace(recognised, nearest_m=5.0)
    row = figures_of([RIGHT, WRONG, recognised, guessed, lost])
    assert row["distinct"] == 2
    assert row["distinct_0.2m_2deg"] == 0.5
    assert row["aliases_recognised"] == pytest.approx(1 / 3, abs=1e-4)


def test_a_second_place_just_as_good_is_an_alias(small_version, small_scans):
    localizer, (scan, T) = Localizer(MapIndex.load(small_version.directory)), small_scans[0]
    right = ask(localizer, scan, T, "w", "c")
    assert right.standing is Standing.DISTINCT
    elsewhere = T @ make_transform(
        np.eye(3), [30.0, 0, 0]
    )  # were the truth there, the answer would be better
    wrong = ask(localizer, scan, elsewhere, "w", "c")
    assert wrong.standing is Standing.OUTSHONE


def test_an_alias_fits_nearly_as_well_or_a_little_better():
    true = AlignmentQuality(0.9, 0.85, 0.01)
    assert standing_of(true, []) is Standing.DISTINCT
    for score, wanted in ((0.8, Standing.DISTINCT), (0.84, Standing.ALIAS), (0.86, Standing.ALIAS)):
        assert (
            standing_of(true, [AlignmentQuality(0.5, 0.3, 0.0), replace(true, alignment_score=score)])
            is wanted
        )
    assert standing_of(true, [replace(true, alignment_score=0.9)]) is Standing.OUTSHONE
    assert standing_of(true, [replace(true, free_space_violation=0.05)]) is Standing.DISTINCT


def test_bars_of_known_answers():
    alias = replace(WRONG, standing=Standing.ALIAS, verdict=Verdict.AMBIGUOUS)
    doubted = replace(RIGHT, verdict=Verdict.AMBIGUOUS)
    look_alike = replace(NOT_OURS, case=LOOK_ALIKES, verdict=Verdict.REJECTED, probability=0.2)
    row = bars_of([RIGHT, RIGHT, doubted, WRONG, alias, replace(alias, nearest_m=2.0), look_alike])
    assert (row["answers"], row["distinct"], row["aliases"], row["outshone"]) == (7, 4, 2, 0)
    assert (row["first"], row["localized"], row["aliases_recognised"]) == (0.75, 0.5, 0.5)
    assert row["outshone_recognised"] is None
    assert row["false_accepts"] == 1
    assert row["false_accepts_at_most"] == upper_bound(1, 7)
    assert row["wrong_0.2m"] == 1
    assert row["look_alikes_ece"] == pytest.approx(0.2)


def test_the_bound_is_clopper_and_pearsons():
    assert upper_bound(0, 8000) == pytest.approx(
        1 - 0.05 ** (1 / 8000), abs=1e-6
    )  # the rule of three: 3.7 in 10,000
    assert upper_bound(3, 3) == 1.0
    rng = np.random.default_rng(8)
    shares = [upper_bound(int(events), 50) for events in rng.binomial(50, 0.1, 4000)]
    assert np.mean(np.array(shares) >= 0.1) > 0.94


def test_a_part_is_read_as_it_was_kept(tmp_path):
    outcomes = (RIGHT, replace(NOT_OURS, standing=Standing.OUTSHONE))
    part = Part("w", outcomes, {"t": 3}, {"cases": ["c"]}, ("c",), 2.0)
    part.save(tmp_path)
    found = Part.load(tmp_path, "w")
    assert found is not None
    assert found.outcomes[0] == part.outcomes[0]
    assert repr(found) == repr(part)  # nan is not nan
    assert Part.load(tmp_path, "v") is None


def test_sensors_are_drawn_for_each_world_alone():
    case = Case("c", CLEAN, templates=OTHER, queries=ANY)
    drawn = {world.name: template_sensor(case, world) for world in WORLDS}
    assert all(drawn[world.name] != world.config["sensor"] for world in WORLDS)
    assert len(set(drawn.values())) > 3
    assert [template_sensor(case, world) for world in WORLDS] == list(drawn.values())
    shares = dict(asking_sensors(case, WORLDS[0], 100))
    assert set(shares) == set(SENSORS)
    assert sum(shares.values()) == 100
    assert len(list(asking_sensors(case, WORLDS[0], 5))) == 5
    assert list(asking_sensors(Case("d", CLEAN), WORLDS[0], 7)) == [(None, 7)]


def test_an_interrupted_run_goes_on_after_its_last_case(small_map, small_version, tmp_path, monkeypatch):
    begun_as(small_version, tmp_path / "yard" / SENSOR["name"])
    yard = BenchWorld("yard", "yard", CONFIG, lambda cache: WorldFiles(Scenery(small_map)))
    measure_here = partial(measure_world, yard, SOME[:3], Sizes(2, 2, 2), tmp_path, ())
    asked = []

    def interrupted_at(*names: str) -> None:
        def outcomes(world, case, *rest):
            if case.name in names:
                raise KeyboardInterrupt
            asked.append(case.name)
            yield from ask_all(world, case, *rest)

        monkeypatch.setattr(suite, "_outcomes", outcomes)

    ask_all = suite._outcomes
    interrupted_at("all at once")
    with pytest.raises(KeyboardInterrupt):
        measure_here(resume=True)
    interrupted_at()
    part = measure_here(resume=True)
    assert part.is_whole
    assert asked == [case.name for case in SOME[:3]]
    assert [row.case for row in part.outcomes] == ["clean"] * 2 + ["all at once"] * 2 + ["vlp-16 asks"] * 2
    assert repr(Part.load(tmp_path / "parts", "yard")) == repr(measure_here(resume=True))
    assert len(asked) == 3  # a whole part is left as it is
    measure_here(resume=False)
    assert len(asked) == 6


def test_a_part_of_other_code_is_measured_anew(small_map, small_version, tmp_path, monkeypatch):
    begun_as(small_version, tmp_path / "yard" / SENSOR["name"])
    yard = BenchWorld("yard", "yard", CONFIG, lambda cache: WorldFiles(Scenery(small_map)))
    first = measure_world(yard, SOME[:1], Sizes(1, 1, 1), tmp_path, (), resume=True)
    monkeypatch.setattr(suite, "SUITE_SOURCE", {"cases.py": "another"})
    again = measure_world(yard, SOME[:1], Sizes(1, 1, 1), tmp_path, (), resume=True)
    assert again.conditions != first.conditions
    assert len(again.outcomes) == len(first.outcomes)


def test_a_part_that_was_being_written_is_as_before(tmp_path):
    part = Part("w", conditions={"cases": ["c", "d"]}).with_case("c", (RIGHT,), {"t": 3}, 2.0)
    part.save(tmp_path)
    write_outcomes(tmp_path / "w" / "outcomes.csv", (RIGHT, replace(RIGHT, case="d")))  # and then killed
    assert repr(Part.load(tmp_path, "w")) == repr(part)


def test_calibration_error_is_zero_for_an_honest_forecaster_and_the_gap_for_another():
    rng = np.random.default_rng(5)
    claimed = rng.uniform(size=20_000)
    assert calibration_error(claimed, rng.uniform(size=20_000) < claimed) < 0.02
    assert calibration_error([0.9, 0.9, 0.2, 1.0], [True, True, False, True]) == pytest.approx(0.1)


def test_nees_of_an_honest_covariance_is_chi_squared():
    rng, found, answers = np.random.default_rng(6), [], []
    deviation = np.array([0.02, 0.03, 0.01, 0.002, 0.001, 0.004])
    T_true = make_transform(rotation_z(1.0), [5, -2, 1])
    for error in rng.normal(0, deviation, (400, 6)):
        turn = Rotation.from_rotvec(error[3:]).as_matrix()
        T = make_transform(turn @ T_true[:3, :3], T_true[:3, 3] + error[:3])
        answer = Localization(Verdict.LOCALIZED, T_map_sensor=T, covariance=np.diag(deviation**2))
        found.append(nees(T_true, answer))
        answers.append((T_true, answer))
    assert np.median(found) == pytest.approx(5.35, rel=0.15)
    shift, turn = nees_by_class(answers)
    assert (shift["sigma_below"], turn["sigma_below"]) == (0.05, pytest.approx(np.radians(0.5)))
    for row in (shift, turn):
        assert row["n"] == 400
        assert row["nees"] == pytest.approx(1, abs=0.1)
        assert row["nees_with_truth"] < row["nees"]
        assert row["within"] > 0.95
