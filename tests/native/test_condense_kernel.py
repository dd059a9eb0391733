"""The kernel that condenses a scan against NumPy: the same bytes of a compact query, whatever the scan."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
import zstandard
from numpy.typing import NDArray

import firstfix.native as native
from firstfix.bit_exact.accelerated import REFERENCES
from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.errors import InvalidOption
from firstfix.scan.condense import condense, condensed, describe
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.scan.scan import Scan
from firstfix.scan_file import read_scan_file
from firstfix.wire.query import encode_query
from firstfix_client.steps.scan_body import BodyForm, encoded
from tests.every_case import every_case
from tests.needs import recorded

EDGES_M = np.float32([0.3, 1.0, 1.8, 3.0, 6.0, 25.0])
DESCRIPTOR = (20, 60, 60.0, EDGES_M)
DESCRIBED = DescriptorParameters(descriptor=LayeredOccupancy(PolarGrid(20, 60, 60.0)))
RECORDED = [
    "kitti_drive0027_street/queries/key_frame_427.laz",
    "hilti_hall_indoor/queries/scan_044.pcd",
    "yard_vlp16_thin/queries/scan1825.pcd",
    "street_128beam/queries/000052.pcd",
]


def room(count: int, seed: int = 1) -> NDArray[np.float32]:
    """Points on the walls, floor and ceiling of a room of 12 x 8 x 3 m."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-6, -4, -1.2], [6, 4, 1.8], (count, 3))
    side = rng.integers(0, 6, count)
    bounds = np.array([[-6, 6], [-4, 4], [-1.2, 1.8]])
    points[np.arange(count), side // 2] = bounds[side // 2, side % 2]
    return (points + rng.normal(0, 0.01, (count, 3))).astype(np.float32)


def odd_scans() -> Iterator[tuple[str, NDArray[Any]]]:
    walls, rng = room(70_000), np.random.default_rng(2)
    yield "empty", np.zeros((0, 3), np.float32)
    yield "one point", np.float32([[1, 2, 0.5]])
    yield "out of range", np.full((9, 3), 500.0)
    yield "at one place", np.full((50_000, 3), 3.0, np.float32)
    yield "some not finite", np.where(rng.random(walls.shape) < 0.1, np.nan, walls)
    yield "none finite", np.full((40, 3), np.inf)
    yield "some far", np.where(rng.random((len(walls), 1)) < 0.1, np.float32(1e30), walls)
    yield "on the borders of voxels", (rng.integers(-40, 40, (9000, 3)) * 0.3 + 0.0005).astype(np.float32)
    yield "whole millimetres", np.round(walls, 3)
    yield "double", walls.astype(np.float64) + 1e-9
    yield "half", walls[:500].astype(np.float16)
    yield "four columns", np.column_stack([walls, walls[:, :1]])
    yield "every other row", np.repeat(walls[:30_000], 2, axis=0)[::2]
    yield "column by column", np.asfortranarray(walls)
    yield "huge", room(600_001, 3)


ODD = dict(odd_scans())


def timed(points: NDArray[Any]) -> Scan:
    time_s = np.random.default_rng(4).uniform(-0.05, 0.05, len(points))
    return Scan.from_points(points, time_s=time_s)


def assert_equal(found: Any, wanted: Any) -> None:
    if isinstance(wanted, tuple):
        for one, other in zip(found, wanted, strict=True):
            assert_equal(one, other)
    elif isinstance(wanted, np.ndarray):
        assert found.dtype == wanted.dtype
        np.testing.assert_array_equal(found, wanted)
    else:
        assert found == wanted


def assert_agrees(scan: Scan, gravity: NDArray[np.float64] | None = None, **numbers: Any) -> None:
    given = {"min_range_m": 0.5, "max_range_m": 60.0, "voxel_m": 0.3, "most": 2500, **numbers}
    for descriptor in (None, DESCRIPTOR):
        arguments = {"default_height_m": 1.25, "descriptor": descriptor, "gravity": gravity, **given}
        asked = {"points": scan.points, "time_s": scan.time_s, **arguments}
        assert_equal(native.condensed(**asked), REFERENCES["condensed"](**asked))


def test_the_kernel_stands_in_the_place_of_the_function():
    assert condensed is native.condensed


@every_case("name", list(ODD))
def test_an_odd_scan_gives_the_same_numbers(name: str):
    assert_agrees(Scan.from_points(ODD[name]))
    assert_agrees(timed(ODD[name]))


@pytest.mark.parametrize("path", RECORDED)
def test_a_recorded_scan_gives_the_same_numbers(path: str):
    scan = replace(read_scan_file(recorded(path)), time_s=None)
    assert_agrees(scan)
    assert_agrees(timed(scan.points), gravity=np.array([0.3, -0.1, -9.7]))


@every_case(
    "numbers",
    [
        {"min_range_m": 0.0, "max_range_m": 1e4},
        {"min_range_m": 3.0, "max_range_m": 4.0},
        {"min_range_m": 9.0, "max_range_m": 3.0},
        {"voxel_m": 0.01},
        {"voxel_m": 10.0},
        {"most": 1},
        {"most": 10_000},
    ],
)
def test_other_numbers_give_the_same(numbers: dict[str, float]):
    assert_agrees(Scan.from_points(room(50_000)), **numbers)
    assert_agrees(timed(room(50_000)), **numbers)


@every_case(
    "wrong",
    [
        {"voxel_m": 0.001},
        {"voxel_m": float("nan")},
        {"max_range_m": 0.0},
        {"max_range_m": float("inf")},
        {"min_range_m": -1.0},
        {"default_height_m": 101.0},
        {"descriptor": LayeredOccupancy(PolarGrid(20, 60, 60.0), (1.0,))},
        {"descriptor": LayeredOccupancy(PolarGrid(20, 60, 60.0), (1.0, 0.5))},
        {"descriptor": LayeredOccupancy(PolarGrid(201, 60, 60.0))},
        {"descriptor": LayeredOccupancy(PolarGrid(20, 60, 1e6))},
    ],
)
def test_parameters_that_no_map_has_are_refused(wrong: dict[str, Any]):
    parameters = replace(DESCRIBED, **wrong)
    scan = Scan.from_points(room(900))
    for call in (condense, describe):
        with pytest.raises(InvalidOption, match="parameter is out of range"):
            call(scan, parameters)
    rings = parameters.descriptor
    with pytest.raises(InvalidOption, match="parameter is out of range"):
        native.condensed(
            scan.points,
            None,
            parameters.min_range_m,
            parameters.max_range_m,
            parameters.voxel_m,
            parameters.default_height_m,
            (rings.grid.rings, rings.grid.sectors, rings.grid.max_range_m, np.float32(rings.edges_m)),
            None,
            2500,
        )


@every_case("gravity", [np.zeros(3), np.full(3, np.nan), np.full(3, np.inf), np.ones(2)])
def test_gravity_without_a_direction_is_refused(gravity: NDArray[np.float64]):
    for call in (condense, describe):
        with pytest.raises(InvalidOption, match="no direction"):
            call(Scan.from_points(room(900)), DESCRIBED, gravity)


def test_times_that_are_not_those_of_the_points_are_refused():
    numbers = (0.5, 60.0, 0.3, 1.0, None, None, 100)
    for time_s in (np.zeros(8, np.float32), np.full(9, np.nan, np.float32)):
        with pytest.raises(ValueError, match="time"):
            native.condensed(np.zeros((9, 3), np.float32), time_s, *numbers)


ON_THE_ROBOT = """
import sys
import numpy as np
from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.scan.scan import Scan
from firstfix_client.steps.scan_body import BodyForm, encoded

described = DescriptorParameters(descriptor=LayeredOccupancy(PolarGrid(20, 60, 60.0)))
forms = [BodyForm("compact"), BodyForm("compact", described), BodyForm("descriptor", described)]
for name, points in np.load(sys.argv[1]).items():
    time_s = np.random.default_rng(4).uniform(-0.05, 0.05, len(points))
    for scan in (Scan.from_points(points), Scan.from_points(points, time_s=time_s)):
        for number, form in enumerate(forms):
            for gravity in (None, np.array([0.5, 0.2, -9.6])):
                print(name, number, encoded(scan, form, gravity)[1].hex())
"""


def test_a_robot_without_the_compiled_core_sends_the_same_bytes(tmp_path: Path):
    np.savez(tmp_path / "scans.npz", **{name: points for name, points in ODD.items() if name != "huge"})
    sent = []
    for chosen in ("off", "auto"):
        done = subprocess.run(
            [sys.executable, "-c", ON_THE_ROBOT, tmp_path / "scans.npz"],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "FIRSTFIX_NATIVE": chosen},
        )
        sent.append(done.stdout.splitlines())
    assert len(sent[0]) == 12 * (len(ODD) - 1)
    assert sent[0] == sent[1]


def test_a_read_only_scan_stays_as_it_is():
    points = room(5000)
    before = points.copy()
    points.setflags(write=False)
    first = encoded(points, BodyForm("compact"))
    assert encoded(points, BodyForm("compact")) == first
    np.testing.assert_array_equal(points, before)


def test_threads_do_not_share_the_memory_of_their_scans():
    scans = [Scan.from_points(room(20_000 + 5000 * seed, seed)) for seed in range(6)]
    wanted = [encode_query(condense(scan, DESCRIBED)) for scan in scans]
    found: list[list[bytes]] = [[] for _ in scans]

    def work(number: int) -> None:
        for _ in range(5):
            found[number].append(encode_query(condense(scans[number], DESCRIBED)))

    threads = [Thread(target=work, args=(number,)) for number in range(len(scans))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [[one] * 5 for one in wanted]


def test_a_kept_compressor_gives_the_frames_of_a_new_one():
    kept, rng = zstandard.ZstdCompressor(level=12), np.random.default_rng(5)
    for size in rng.integers(0, 40_000, 60):
        content = (rng.geometric(rng.uniform(0.02, 0.9), size) % 256).astype(np.uint8).tobytes()
        assert kept.compress(content) == zstandard.ZstdCompressor(level=12).compress(content)
