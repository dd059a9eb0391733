import json

import numpy as np
import pytest

from firstfix_builder.self_test.localizability import (
    CELL_M,
    QueriedPlace,
    SeenFloor,
    draw_localizability,
    grid_of,
)

pytestmark = pytest.mark.slow

FAR = np.array([41.0, 0.5, 1.0])


def place(x: float, outcome: str, rival=None, found=None) -> QueriedPlace:
    is_found = outcome == "localized" if found is None else found
    return QueriedPlace(np.array([x, 0.5, 1.0]), outcome, rival, is_found)


def test_cells_count_what_happened_in_them_and_name_what_they_resemble():
    places = [
        place(0.5, "localized"),
        place(1.0, "unsure", FAR, found=True),
        place(1.5, "wrong", FAR),
        place(2.0, "unsure", np.array([-30.0, 0, 0])),
        place(-0.5, "localized", FAR),
    ]
    left, right = grid_of(places)
    assert left == {"cell": [-1, 0], "scans": 1, "localized": 1, "wrong": 0, "found": 1, "taken_for": None}
    far = [int(FAR[0] // CELL_M), 0]
    counts = {"scans": 4, "localized": 1, "wrong": 1, "found": 2}
    assert right == {"cell": [0, 0], **counts, "taken_for": far, "helps": "second_scan"}
    json.dumps(grid_of(places))


def test_a_cell_that_is_known_and_not_said_names_what_helps():
    unsure = place(1.0, "unsure", FAR, found=True)
    (cell,) = grid_of([unsure, place(1.5, "unsure", FAR), place(2.0, "localized")])
    assert cell["helps"] == "second_scan"
    (cell,) = grid_of([place(1.0, "unsure", np.array([2.5, 0.5, 4.0]), found=True)])
    assert cell["helps"] == "prior", "the storey above"
    (cell,) = grid_of([place(1.0, "unsure", found=True)])
    assert cell["helps"] == "other_height", "nothing looks like it"
    for others in ([place(1.5, "localized")], [place(1.5, "unsure"), place(2.0, "unsure")]):
        (cell,) = grid_of([unsure, *others])
        assert "helps" not in cell, "half are localized, or fewer are found"


def test_no_spots_are_no_cells():
    assert grid_of([]) == []


def test_floor_without_templates_is_drawn(tmp_path):
    points = np.random.default_rng(0).uniform(0, 40, (500, 3))
    floor = SeenFloor(100.0, 0.12, np.array([[20.0, 20.0, 0.6], [21.0, 20.0, 0.6]]))
    draw_localizability(points, [], tmp_path / "all.png", SeenFloor(100.0, 0.0, np.zeros((0, 3))))
    draw_localizability(points, [], tmp_path / "none.png")
    draw_localizability(points, [], tmp_path / "some.png", floor)
    assert (tmp_path / "all.png").read_bytes() == (tmp_path / "none.png").read_bytes()
    assert (tmp_path / "some.png").read_bytes() != (tmp_path / "none.png").read_bytes()


def test_places_mapped_in_part_are_hatched(tmp_path):
    points = np.random.default_rng(0).uniform(0, 40, (500, 3))
    draw_localizability(points, [], tmp_path / "none.png")
    for name in ("a.png", "b.png"):
        draw_localizability(points, [], tmp_path / name, in_part=[(2, 3), (4, 3)])
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert (tmp_path / "a.png").read_bytes() != (tmp_path / "none.png").read_bytes()


def test_a_map_without_a_trajectory_does_not_say_what_was_seen(small_version):
    tested = small_version.manifest.self_test
    assert tested["floor"] is None
    assert "mapped" not in tested
    assert not any("never_seen" in cell for cell in tested["localizability"])


def test_a_version_carries_grid_and_picture(small_version):
    found = small_version.manifest.self_test["localizability"]
    tested = small_version.manifest.self_test
    assert sum(cell["scans"] for cell in found) == tested["queries"]
    assert sum(cell["found"] for cell in found) / tested["queries"] == pytest.approx(
        tested["found"], abs=1e-4
    )
    assert tested["localized"] <= tested["found"] <= 1
    assert (small_version.directory / "localizability.png").stat().st_size > 1000
    assert "localizability.png" in small_version.manifest.files
