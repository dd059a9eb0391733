"""Which look-alikes a scan tells from the best place: by what the map has there, not by the lead alone."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from firstfix.answer.quality import AlignmentQuality
from firstfix.engine.calibration import Calibration
from firstfix.engine.config import EngineConfig
from firstfix.engine.index import FreeSpaceShares
from firstfix.engine.ranking import RANKING
from firstfix.engine.registered_candidate import RegisteredCandidate
from firstfix.engine.registration.align import Registration
from firstfix.engine.retrieval.template_tiles import TemplateTiles
from firstfix.native import are_parted, is_one_thing, may_lack
from firstfix.transform import make_transform
from tests.reference.look_alikes import with_look_alikes_marked
from tests.reference.verdict import features_of

BEST = AlignmentQuality(0.91, 0.88, 0.0, 0.0105)
IN_A_ROW = np.array([[0.0, 0, 1], [9, 0, 1], [18, 0, 1]])


def lacks(place: AlignmentQuality, best: AlignmentQuality = BEST) -> bool:
    return may_lack(RANKING, place.alignment_score, place, best)


def test_a_room_that_was_seen_through_its_door_alone_may_be_the_true_one():
    """Four in ten points meet nothing, and the scan passes through nothing that the map has."""
    assert lacks(AlignmentQuality(0.67, 0.61, 0.0, 0.0021))


def test_a_room_whose_furniture_the_scan_does_not_show_is_another_one():
    assert not lacks(AlignmentQuality(0.67, 0.61, 0.0, 0.04))
    assert not lacks(AlignmentQuality(0.67, 0.61, 0.004, 0.0105))


def test_a_room_that_the_mapping_run_saw_free_where_the_scan_has_points_is_another_one():
    seen = AlignmentQuality(0.67, 0.61, 0.0, 0.0105, seen_free=0.1)
    assert not lacks(seen)


def test_a_room_that_fits_well_is_not_missing_unless_the_best_one_is_contradicted_more():
    assert not lacks(AlignmentQuality(0.85, 0.80, 0.0, 0.0105))
    assert lacks(AlignmentQuality(0.74, 0.69, 0.0, 0.003))


def test_a_room_of_which_not_even_the_walls_agree_is_another_one():
    assert not lacks(AlignmentQuality(0.3, 0.25, 0.0, 0.0))


def test_a_map_whose_surfaces_have_all_moved_tells_nothing_by_them():
    """Most parked vehicles have left, at the true place as well."""
    gone = AlignmentQuality(0.8, 0.75, 0.0, 0.6)
    assert lacks(AlignmentQuality(0.6, 0.5, 0.0, 0.65), gone)


def test_a_person_gives_no_look_alike_its_lead():
    """Two wards of a hospital: 3 in a hundred points do not fit in the true one, where somebody stood."""
    best, true = AlignmentQuality(1.0, 0.984, 0.0, 0.0), AlignmentQuality(0.972, 0.951, 0.0, 0.0)
    assert RANKING.support(best) - RANKING.support(true) > 0.1
    assert is_one_thing(RANKING, true, best)
    assert not is_one_thing(RANKING, AlignmentQuality(0.93, 0.91, 0.0, 0.0), best)
    assert not is_one_thing(RANKING, AlignmentQuality(0.972, 0.951, 0.01, 0.0), best)


def test_a_look_alike_is_told_apart_by_a_clear_lead():
    lead, mapped = np.array([0.0, 0.1, 0.05]), np.zeros(3, bool)
    assert are_parted(lead, mapped, IN_A_ROW).tolist() == [False, True, False]


def test_no_lead_tells_a_room_apart_that_the_map_may_lack():
    lead = np.array([0.0, 0.2, 0.2])
    assert are_parted(lead, np.array([False, True, False]), IN_A_ROW).tolist() == [False, False, True]


def test_rooms_above_each_other_are_never_told_apart():
    lead, mapped = np.array([0.0, 0.2, 0.2]), np.zeros(3, bool)
    at_m = np.array([[0.0, 0, 1], [0.5, 0, 4.4], [9, 0, 4.4]])
    assert are_parted(lead, mapped, at_m).tolist() == [False, False, True]


@dataclass(frozen=True)
class OneFloor:
    """An index without aliases: all templates are on one floor, and the calibration is the prior."""

    config: EngineConfig = field(default_factory=EngineConfig)
    calibration: Calibration = field(default_factory=Calibration)
    aliases: None = None
    T_map_level: np.ndarray = field(default_factory=lambda: np.eye(4))

    @property
    def cascade(self) -> SimpleNamespace:
        position_m = np.column_stack([np.arange(40.0), np.zeros(40), np.ones(40)]).astype(np.float32)
        templates = SimpleNamespace(position_m=position_m, height_m=np.ones(40, np.float32))
        return SimpleNamespace(templates=templates, tiles=TemplateTiles.of(position_m))


def registered(index: OneFloor, x_m: float, fit: AlignmentQuality, twist: np.ndarray | None):
    shares = FreeSpaceShares(fit.free_space_violation, fit.removed_surface)
    T = make_transform(np.eye(3), [x_m, 0, 1])
    placed = Registration(T, fit.inlier_ratio, fit.alignment_score, np.eye(6), twist=twist)
    return RegisteredCandidate(index, "office", 0, placed, shares)


@pytest.mark.parametrize(("yaw_rad_s", "alike"), [(0.5, [False, True, False]), (0.0, [False] * 3)])
def test_in_motion_a_room_that_the_map_lacks_is_not_told_apart(yaw_rad_s, alike):
    """No alias of the best place, 28 m away. At rest a worse fit of places that differ tells them apart."""
    index, twist = OneFloor(), np.array([0, 0, 0, 0, 0, yaw_rad_s])
    fits = [BEST, AlignmentQuality(0.67, 0.61, 0.0, 0.0021), AlignmentQuality(0.67, 0.61, 0.0, 0.04)]
    found = [registered(index, x, fit, twist) for x, fit in zip((0.0, 28.0, 14.0), fits, strict=True)]
    marked = with_look_alikes_marked(found, None)
    assert [one.is_alike for one in marked] == alike
    assert features_of(marked).tied == (2 if any(alike) else 1)
