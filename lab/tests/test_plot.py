"""The picture shows the right things in the right colours and places."""

from __future__ import annotations

import json

import numpy as np
from matplotlib import image

from firstfix.answer.localization import Localization, Verdict
from firstfix.scan.scan import Scan
from firstfix.transform import make_transform, rotation_z
from firstfix_lab.evaluation.outcome import Outcome, outcome_of, report_of
from firstfix_lab.evaluation.plot import MapPicture, draw

RED, GREEN, GREY = (0xD7, 0x30, 0x27), (0x1A, 0x98, 0x50), (0x7F, 0x7F, 0x7F)
TRUTH = make_transform(rotation_z(0.3), [5.0, 5.0, 1.0])


def room() -> MapPicture:
    """10 x 10 m with walls, a floor and a ceiling."""
    rng = np.random.default_rng(0)
    floor = np.column_stack([rng.uniform(0, 10, (4000, 2)), np.zeros(4000)])
    wall = np.column_stack([np.zeros(4000), rng.uniform(0, 10, 4000), rng.uniform(0, 3, 4000)])
    return MapPicture(np.concatenate([floor, wall, floor + [0, 0, 3]]), np.array([[5.0, 5.0, 1.0]]))


def outcome(off_m: float | None, truth: np.ndarray | None = TRUTH) -> Outcome:
    if off_m is None:
        return outcome_of("a", truth, Localization(Verdict.REJECTED), 1.0)
    T = make_transform(TRUTH[:3, :3], TRUTH[:3, 3] + [off_m, 0, 0])
    return outcome_of("a", truth, Localization(Verdict.LOCALIZED, T_map_sensor=T), 1.0)


def pixels(path, outcomes, picture=None, scans=None) -> np.ndarray:
    draw(path, "room", picture, outcomes, scans or {}, report_of(outcomes))
    return (image.imread(path)[:, :, :3] * 255).round().astype(int)


def count_of(colour, drawn: np.ndarray) -> int:
    return int((np.abs(drawn - colour).max(axis=2) <= 2).sum())


def test_a_wrong_answer_is_red_and_a_right_one_green(tmp_path):
    right = pixels(tmp_path / "a.png", [outcome(0.05)])
    wrong = pixels(tmp_path / "b.png", [outcome(3.0)])
    nothing = pixels(tmp_path / "c.png", [outcome(None)])
    assert count_of(GREEN, right) > count_of(GREEN, wrong) + 100
    assert count_of(RED, wrong) > count_of(RED, right) + 100
    assert count_of(GREY, nothing) > count_of(GREY, right) + 20


def test_the_scan_is_laid_over_the_map_at_the_answered_pose(tmp_path):
    rng = np.random.default_rng(1)
    scan = Scan.from_points(np.column_stack([rng.uniform(-4, 4, (3000, 2)), np.zeros(3000)]))
    without = pixels(tmp_path / "a.png", [outcome(0.05)], room())
    drawn = pixels(tmp_path / "b.png", [outcome(0.05)], room(), {"a": scan})
    assert count_of(GREEN, drawn) > count_of(GREEN, without) + 2000


def test_ceilings_do_not_hide_the_room():
    shown = room().below_ceilings()
    assert shown[:, 2].max() < 1.0 + 0.71
    assert (shown[:, 2] == 0).sum() == 4000
    assert (np.diff(shown[:, 2]) >= 0).all()


def test_nothing_to_show_is_still_a_picture(tmp_path):
    assert pixels(tmp_path / "a.png", [outcome(None, truth=None)]).size


def test_the_picture_of_a_version_is_in_the_maps_frame(tmp_path):
    T_map_level = make_transform(rotation_z(np.pi / 2), [100.0, 0.0, 0.0])
    (tmp_path / "engine.json").write_text(json.dumps({"T_map_level": T_map_level.ravel().tolist()}))
    np.save(tmp_path / "map_points.npy", np.array([[1, 0, 0]], np.float32))
    np.save(tmp_path / "template_position_m.npy", np.array([[0, 2, 1]], np.float32))
    picture = MapPicture.load(tmp_path)
    np.testing.assert_allclose(picture.points, [[100, 1, 0]], atol=1e-6)
    np.testing.assert_allclose(picture.templates, [[98, 0, 1]], atol=1e-6)
