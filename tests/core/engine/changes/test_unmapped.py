"""New things told from parts that were never mapped: a screen hides half of a hall from its mapping run."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.engine.changes.areas import Area, find_areas
from firstfix.engine.changes.cells import cells_of_keys, keys_of
from firstfix.engine.changes.collector import Collector
from firstfix.engine.changes.sighting import Sighting, sighting_of
from firstfix.engine.changes.tally import Tally
from firstfix.engine.changes.unmapped import unmapped_of
from firstfix.engine.index import MapIndex
from tests.changed_hall import Hall, driven, free_poses, standing, with_error
from tests.every_case import every_case

SIZE_M = (16.0, 10.0, 4.0)
SCREEN = (8.0, 2.0, 0.0, 8.4, 8.0, 2.6)
HIDDEN = (10.3, 3.9, 0.0, 11.4, 6.2, 1.5)  # stood behind the screen all the time
RACK = (3.1, 6.8, 0.0, 4.2, 8.9, 2.3)  # has come
DRIVE_M = np.column_stack([np.linspace(1.5, 6.5, 11), np.full(11, 5.0), np.full(11, 1.0)])
NOW = Hall(SIZE_M, standing(SCREEN, HIDDEN, RACK))
NOTHING = np.empty(0, np.int64)


@pytest.fixture(scope="module")
def mapped() -> MapIndex:
    return driven(Hall(SIZE_M, standing(SCREEN, HIDDEN)), DRIVE_M)


@pytest.fixture(scope="module")
def without_trajectory() -> MapIndex:
    return driven(Hall(SIZE_M, standing(SCREEN, HIDDEN)), DRIVE_M, with_seen_free=False)


def sightings(index: MapIndex, count: int = 40) -> list[Sighting]:
    """Of robots in all parts of the hall as it is now."""
    rng, simulator = np.random.default_rng(0), NOW.simulator()
    poses = free_poses(simulator, SIZE_M, count, rng)
    return [sighting_of(index, NOW.scan(simulator, T, rng), with_error(T, rng)) for T in poses]


def within(cells: NDArray[np.int64], box: tuple[float, ...]) -> NDArray[np.bool_]:
    """Which cells' middles lie in a box, 0.3 m around it."""
    middle = (cells + 0.5) * 0.5
    return ((middle > np.array(box[:3]) - 0.3) & (middle < np.array(box[3:]) + 0.3)).all(axis=1)


def counted(told: list[Sighting]) -> list[Area]:
    collector = Collector()
    for one in told:
        collector.add(one)
    return find_areas(collector.take())


def test_unmapped_cells_were_never_seen(mapped: MapIndex):
    told = sightings(mapped)
    assert all(one.knows_coverage for one in told)
    unexplained = np.concatenate([one.unexplained for one in told])
    unmapped = np.concatenate([one.unmapped for one in told])
    for one in told:
        assert np.isin(one.unmapped, one.unexplained, assume_unique=True).all()
        assert (np.diff(one.unmapped) > 0).all()
    hidden, came = (
        [int(within(cells_of_keys(keys), box).sum()) for keys in (unexplained, unmapped)]
        for box in (HIDDEN, RACK)
    )
    assert hidden[0] > 200
    assert hidden[1] == hidden[0]
    assert came[0] > 500
    assert came[1] < 0.03 * came[0], "a floor that the drive saw from too far away"
    beyond = cells_of_keys(unmapped)[:, 0] * 0.5
    assert np.mean(beyond >= 8) > 0.9, "the mapping run saw its side of the screen"


def test_areas_are_of_one_kind(mapped: MapIndex):
    areas = counted(sightings(mapped))
    new = [area for area in areas if area.kind == "new"]
    assert len(new) == 1
    assert within(new[0].cells, RACK).mean() > 0.9
    unmapped = np.concatenate([area.cells for area in areas if area.kind == "unmapped"])
    assert within(unmapped, HIDDEN).sum() > 20
    assert not within(unmapped, RACK).any()
    assert [area.kind for area in areas[: len(new)]] == ["new"], "changes come first, whatever their size"


def test_telling_unmapped_from_new_loses_nothing(mapped: MapIndex, without_trajectory: MapIndex):
    """All cells of areas, and all that a sighting says besides, are those of a map that does not know."""
    known, unknown = sightings(mapped), sightings(without_trajectory)
    for one, other in zip(known, unknown, strict=True):
        assert (len(other.unmapped), other.knows_coverage) == (0, False)
        for name in ("confirmed", "contradicted", "unexplained", "free"):
            assert np.array_equal(getattr(one, name), getattr(other, name))
    cells = []
    for told, kinds in ((known, {"new", "unmapped"}), (unknown, {"new"})):
        areas = counted(told)
        assert {area.kind for area in areas} == kinds
        cells.append(sorted(int(key) for area in areas for key in keys_of(area.cells)))
    assert cells[0] == cells[1]


def told(spot: int, cells: NDArray[np.int64], *, unmapped: bool) -> Tally:
    keys = np.sort(keys_of(cells))
    is_never_seen = keys if unmapped else NOTHING
    return Tally.of(Sighting((7 * spot, 0, 1), NOTHING, NOTHING, keys, NOTHING, is_never_seen, True))


ROW = np.array([[x, 4, 2] for x in range(8)])


def test_each_spot_has_one_vote_about_unmapped_cells():
    """A robot that stands at one spot does not outvote seven others."""
    parked = Tally.sum([told(0, ROW, unmapped=False)] * 100)
    others = Tally.sum([told(spot, ROW, unmapped=True) for spot in range(1, 8)])
    (area,) = find_areas(Tally.sum([parked, others]))
    assert (area.kind, len(area.cells)) == ("unmapped", 8)
    both = Tally.sum([parked, others])
    assert (both.sightings, both.coverage_known) == (107, 107)
    both.check()


def test_sightings_without_seen_free_space_speak_for_new():
    keys = np.sort(keys_of(ROW))
    before = Tally.sum(
        [Tally.of(Sighting((7 * n, 0, 1), NOTHING, NOTHING, keys, NOTHING)) for n in range(20)]
    )
    assert [area.kind for area in find_areas(before)] == ["new"]
    assert before.coverage_known == 0
    since = Tally.sum([told(n, ROW, unmapped=True) for n in range(20, 30)])
    total = Tally.sum([before, since])
    assert (total.sightings, total.coverage_known) == (30, 10)
    assert [area.kind for area in find_areas(total)] == ["new"]
    total = Tally.sum([before, Tally.sum([told(n, ROW, unmapped=True) for n in range(60)])])
    assert [area.kind for area in find_areas(total)] == ["unmapped"]


@every_case(
    ("text", "is_unmapped"),
    [
        ("nnnnnnnn", "nnnnnnnn"),
        ("uuuuuuuu", "uuuuuuuu"),
        ("uuuunnnn", "uuuunnnn"),
        ("uunnnnnn", "nnnnnnnn"),  # too few cells for an area of their own
        ("uuuuuunn", "uuuuuuuu"),
        ("uuunnuuu", "uuuuuuuu"),
        ("unununun", "nnnnnnnn"),
        ("uu......", "uu......"),  # touches nothing
        ("nn...uuu", "nn...uuu"),
        ("u.nnn.uu", "u.nnn.uu"),
        ("nu......", "nn......"),
    ],
)
def test_small_parts_take_the_kind_that_they_touch(text: str, is_unmapped: str):
    rows = [row for row, letter in enumerate(text) if letter != "."]
    share = np.array([text[row] == "u" for row in rows], np.float64)
    found = ["."] * len(text)
    for row, one in zip(rows, unmapped_of(ROW[rows], share), strict=True):
        found[row] = "u" if one else "n"
    assert "".join(found) == is_unmapped


def test_a_tally_that_calls_more_cells_unmapped_than_unexplained_is_refused():
    good = told(1, ROW, unmapped=True)
    good.check()
    values = {field.name: getattr(good, field.name) for field in fields(good)}
    counts = good.counts.copy()
    counts[3, 4] = 2
    for changed in (
        {"counts": counts},
        {"coverage_known": 2},
        {"coverage_known": -1},
        {"counts": counts[:, :4]},
    ):
        with pytest.raises(ValueError, match=r"tally|sightings"):
            Tally(**{**values, **changed}).check()
