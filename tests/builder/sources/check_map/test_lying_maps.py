"""Maps and poses that are not what they seem have their findings, and like ones that are right have none."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.findings.finding import Finding
from firstfix.scan.reduction import voxel_means
from firstfix.transform import make_transform, rotation_z
from firstfix_builder.sources.check_map.check_map import check_map, has_fit_poses
from firstfix_builder.sources.check_map.precision import check_precision
from firstfix_builder.sources.check_map.sensor_poses import with_sensor_poses
from firstfix_builder.sources.check_map.shape import Shape
from firstfix_builder.sources.check_map.upright_poses import check_upright
from firstfix_builder.sources.read_map.map_data import MapData, local_origin, subtract_origin
from firstfix_builder.sources.read_map.rigid import rigid_from_quaternions
from tests.builder.sources.check_map.even_hall import SENSOR_M, SIZE, hall, posed, way
from tests.every_case import every_case


def check(points: np.ndarray, positions: np.ndarray | None, source: str = "given") -> list[Finding]:
    poses = None if positions is None else posed(positions)
    data = MapData(points=points, trajectory=poses, trajectory_source=source)
    data = subtract_origin(data, local_origin(data))
    return check_map(data, data.trajectory)


def codes(points: np.ndarray, positions: np.ndarray | None = None, source: str = "given") -> list[str]:
    return [one.code for one in check(points, positions, source)]


@pytest.fixture(scope="module")
def right() -> np.ndarray:
    return hall()


def leaning(positions: np.ndarray, lean_deg: float) -> np.ndarray:
    """Rising along x, about their middle."""
    leaned = positions.copy()
    leaned[:, 2] += np.tan(np.radians(lean_deg)) * (positions[:, 0] - positions[:, 0].mean())
    return leaned


def ramp(points: np.ndarray, slope_deg: float = 8.0) -> np.ndarray:
    """Points (or positions) of a hall on a slope, whose poses follow it."""
    sloped = points.copy()
    sloped[:, 2] += np.tan(np.radians(slope_deg)) * points[:, 0]
    return sloped


def storeys(points: np.ndarray) -> np.ndarray:
    """With a second storey 4.3 m higher, on a slab of 0.3 m."""
    return np.concatenate([points, points + [0, 0, SIZE[2] + 0.3]])


def both_ways() -> np.ndarray:
    """A way through each of both storeys."""
    return np.concatenate([way(), way(SENSOR_M + SIZE[2] + 0.3)])


def sunk(points: np.ndarray, by_m: float) -> np.ndarray:
    """And again what is between x = 0 and 28 m, by so much lower at its beginning."""
    again = points[points[:, 0] < 28].copy()
    again[:, 2] -= by_m * (1 - again[:, 0] / 28)
    return np.concatenate([points, again])


def there_and_sunk(by_m: float) -> np.ndarray:
    """A way there, and in the same aisle back, ever deeper."""
    there = way()[:60]
    back = there[::-1].copy()
    back[:, 2] -= by_m * (1 - back[:, 0] / 28)
    return np.concatenate([there, back])


@every_case(
    ("change", "positions", "expected"),
    [
        (lambda points: points, None, []),
        (lambda points: points, way, []),
        (lambda points: points + [450_000.0, 5_200_000.0, 300.0], None, []),
        (ramp, None, []),
        (ramp, lambda: ramp(way()), []),
        (storeys, both_ways, []),
        (lambda points: points, lambda: way(0.0), ["trajectory_of_base"]),
        (lambda points: points, lambda: way(-0.05), ["trajectory_of_base"]),
        (lambda points: points, lambda: way(0.1), ["trajectory_at_floor"]),
        (lambda points: points, lambda: way(0.2), []),
        (lambda points: points, lambda: leaning(way(), 4), ["trajectory_leans"]),
        (lambda points: points, lambda: leaning(way(0.0), 10), ["trajectory_leans"]),
        (lambda points: sunk(points, 0.6), lambda: there_and_sunk(0.6), ["map_doubled_floors"]),
        (lambda points: sunk(points, 0.3), lambda: there_and_sunk(0.3), ["map_doubled_floors"]),
        (lambda points: sunk(points, 0.6), None, ["map_doubled_floors"]),
        (lambda points: points[points[:, 2] > 0.35], way, ["map_no_ground"]),
        (lambda points: points[points[:, 2] > 0.35], None, ["map_no_ground"]),
        (lambda points: storeys(points[points[:, 2] > 0.35]), both_ways, ["map_no_ground"]),
    ],
    ids=[
        *(
            "right",
            "right with poses",
            "UTM",
            "ramp",
            "ramp with poses",
            "storeys",
            "base",
            "base in the floor",
        ),
        *(
            "low",
            "low sensor",
            "leans by 4",
            "base's leans by 10",
            "sunk by 0.6",
            "sunk by 0.3",
            "sunk, no poses",
        ),
        *("no ground", "no ground, no poses", "no ground in two storeys"),
    ],
)
def test_a_map_has_the_findings(right: np.ndarray, change, positions, expected: list[str]):
    assert codes(change(right), None if positions is None else positions()) == expected


def test_a_lean_is_told_in_degrees_with_its_direction_and_its_ends(right: np.ndarray):
    (found,) = check(right, leaning(way(), -5))
    assert found.numbers["lean_deg"] == pytest.approx(5, abs=0.3)
    assert abs(found.numbers["direction_deg"]) == pytest.approx(180, abs=5)
    assert [place[0] > 20 for place in found.places] == [True, False], "lowest first"


def test_doubled_floors_are_told_with_share_distance_and_places_of_the_file(right: np.ndarray):
    far = np.array([450_000.0, 5_200_000.0, 0.0])
    (found,) = check(sunk(right, 0.6) + far, there_and_sunk(0.6) + far)
    assert 0.12 < found.numbers["apart_m"] < found.numbers["largest_m"] <= 0.6
    assert found.numbers["doubled_share"] > 0.5
    assert all(0 <= x - far[0] <= 28 and 0 <= y - far[1] <= SIZE[1] for x, y, _ in found.places)
    assert Finding.from_mapping(found.to_mapping()) == found


def test_the_mount_height_makes_poses_of_a_base_those_of_the_sensor(right: np.ndarray):
    data = MapData(points=right, trajectory=posed(way(0.0)), trajectory_source="given")
    lifted = with_sensor_poses(data, SENSOR_M)
    assert check_map(lifted, lifted.trajectory) == []
    tilted = make_transform(
        np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]), np.zeros(3)
    )  # z along the map's x
    moved = with_sensor_poses(MapData(points=right, trajectory=tilted[None]), 0.4)
    np.testing.assert_allclose(moved.trajectory[0, :3, 3], [0.4, 0, 0], atol=1e-12)
    assert with_sensor_poses(data, 0.0) is data


def test_poses_that_came_with_the_map_refuse_it_never(right: np.ndarray):
    aside = way() + [500.0, 0, 0]
    assert codes(right, aside) == ["trajectory_elsewhere"]
    found = check(right, aside, "file")
    assert [one.code for one in found] == ["trajectory_left_out"]
    assert "100% of them lie over 20 m outside" in found[0].text
    assert not has_fit_poses(found)
    assert has_fit_poses(check(right, way(), "file"))
    assert codes(right[right[:, 2] > 0.35], aside, "file") == ["trajectory_left_out", "map_no_ground"]


def test_a_map_with_y_up_has_no_findings_of_what_lies_along_z():
    scan = scanned(np.array([12.0, 8.0, SENSOR_M]), 0.0)
    assert codes(scan) == ["map_single_scan"]
    assert codes(scan[:, [1, 2, 0]]) == ["map_not_level"]


def scanned(at: np.ndarray, turn_deg: float) -> np.ndarray:
    """The hall as one scan of 16 rings sees it: the nearest point in each direction."""
    seen = hall(0.03) - at  # so dense that near directions have their points, too
    range_m = np.linalg.norm(seen, axis=1)
    turn = np.floor(np.degrees(np.arctan2(seen[:, 1], seen[:, 0])) / 0.5)
    rise = np.floor(np.degrees(np.arcsin(seen[:, 2] / range_m)) / 0.5)
    order = np.lexsort((range_m, rise, turn))
    _, first = np.unique((turn * 1000 + rise)[order], return_index=True)
    nearest = order[first]
    nearest = nearest[(rise[nearest] % 4 == 0) & (np.abs(rise[nearest]) < 60)]
    return seen[nearest] @ rotation_z(np.radians(turn_deg)).T


@pytest.mark.parametrize(("shift_m", "turn_deg"), [((0, 0, 0), 0), ((30, -12, 2), 40)])
def test_a_single_scan_is_named_in_its_own_frame_and_in_another(shift_m, turn_deg):
    (found,) = check(scanned(np.array([12.0, 8.0, 1.0]), turn_deg) + shift_m, None)
    assert found.code == "map_single_scan"
    np.testing.assert_allclose(found.places[0][:2], shift_m[:2], atol=1.5)


def test_a_thin_map_of_one_room_is_no_single_scan(right: np.ndarray):
    assert "map_single_scan" not in codes(voxel_means(right, 0.6))


def with_some_twice(points: np.ndarray) -> np.ndarray:
    """Two maps that overlap in a tenth."""
    return np.concatenate([points, points[::10]])


@every_case(
    ("write", "expected"),
    [
        (lambda points: points, None),
        (lambda points: np.round(points, 2), None),
        (lambda points: np.round(points * 32) / 32, None),
        (lambda points: np.round(points * [10, 10, 1000]) / [10, 10, 1000], "map_digits_few"),
        (lambda points: np.round(np.concatenate([points, points + 0.03]), 1), "map_digits_few"),
        (lambda points: np.round(points * 4) / 4, "map_digits_lost"),
        (lambda points: np.unique(np.round(points, 1), axis=0), None),
        (lambda points: np.unique(np.round(points * 4), axis=0) / 4, None),
        (lambda points: np.tile(np.unique(np.round(points * 4), axis=0) / 4, (2, 1)), None),
        (lambda points: with_some_twice(np.unique(np.round(points * 4), axis=0) / 4), "map_digits_few"),
        (lambda points: (points + [450_000, 5_200_000, 0]).astype(np.float32).astype(float), "map_float32"),
    ],
    ids=[
        *("doubles", "centimetres", "1/32 m", "0.1 m in x and y", "0.1 m", "0.25 m", "voxels of 0.1 m"),
        *("voxels of 0.25 m", "twice the same", "some twice", "float32"),
    ],
)
def test_the_step_of_coordinates_is_measured(right: np.ndarray, write, expected: str | None):
    found = check_precision(write(right))
    assert (found.code if found else None) == expected


def test_lost_digits_are_told_with_their_cause(right: np.ndarray):
    text = np.array([[float(f"{value:g}") for value in row] for row in right[::20] + [42_300, 89_600, 0]])
    found = check_precision(text)
    assert found is not None
    assert "lie on steps of 0.1 m" in found.text
    assert "written with 6 digits" in found.text
    coarse = check_precision(np.round(right * 4) / 4)
    assert coarse is not None
    assert "scale of a LAS" in coarse.remedy


def test_rows_of_zeros_among_large_coordinates_are_no_part_of_the_extent(right: np.ndarray):
    far = right + [450_000.0, 5_200_000.0, 300.0]
    shape = Shape.of(MapData(points=np.concatenate([far, np.zeros((len(far) // 50, 3))])))
    assert shape.extent_m[:2] == pytest.approx(SIZE[:2], rel=0.02)
    assert shape.whole == "450,040 x 5,200,016 x 304 m"
    assert Shape.of(MapData(points=right)).whole == ""


def test_above_ten_thousand_kilometres_no_unit_is_named(right: np.ndarray):
    rng = np.random.default_rng(3)
    (found,) = check_map(MapData(points=rng.uniform(-2e7, 2e7, (5_000, 3))))
    assert found.code == "map_garbled"
    assert "--scale" not in found.remedy


def quaternions(way: np.ndarray, hangs: bool) -> np.ndarray:
    """Of poses that look along their way: (m, 4) x y z w; of a sensor that hangs upside down or stands."""
    step = np.gradient(way, axis=0)
    half = np.arctan2(step[:, 1], step[:, 0]) / 2
    zero = np.zeros(len(way))
    if hangs:
        return np.column_stack([np.cos(half), np.sin(half), zero, zero])
    return np.column_stack([zero, zero, np.sin(half), np.cos(half)])


@every_case(
    ("hangs", "w_first", "expected"),
    [(False, False, None), (False, True, "trajectory_w_first"), (True, False, None), (True, True, None)],
)
def test_poses_that_stand_upright_with_w_first_alone_are_named(hangs: bool, w_first: bool, expected):
    turn = np.linspace(0, 1.9 * np.pi, 50)
    positions = np.column_stack([4 * np.cos(turn), 3 * np.sin(turn), np.ones(50)])
    q = quaternions(positions, hangs)
    poses = rigid_from_quaternions(positions, np.roll(q, 1, axis=1) if w_first else q)
    found = check_upright(poses)
    assert (None if found is None else found.code) == expected
    straight = rigid_from_quaternions(positions, np.tile([1.0, 0, 0, 0], (50, 1)))
    named = check_upright(straight)  # hangs, or drives straight on with w first: asked
    assert named is not None
    assert "qw qx qy qz" in named.remedy
    assert check_upright(poses[:2]) is None


def test_a_map_too_thin_to_show_a_floor_is_not_without_ground(right: np.ndarray):
    some = right[rows_by_chance(len(right), 1200)]
    assert "map_no_ground" not in codes(some, way())
    assert "map_no_ground" in codes(right[right[:, 2] > 0.35], way())
