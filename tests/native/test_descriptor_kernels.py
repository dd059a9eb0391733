"""Kernels of descriptor and search in every instruction set: the results of NumPy, and no stray reads."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firstfix import native
from firstfix.bit_exact.accelerated import REFERENCES
from firstfix.descriptor import LayeredOccupancy
from firstfix.native import choice
from firstfix.scan.levelling import levelling_rotation
from firstfix.scan_file import read_scan_file
from tests.every_case import every_case
from tests.needs import recorded
from tests.reference.spread_out import spread_out

STREET = "kitti_drive0027_street/queries"
EDGES_M = LayeredOccupancy.edges_m
SECTORS = st.sampled_from([1, 7, 60, 63, 64, 65, 360, 720])
KERNELS: list[ModuleType] = [import_module(f"firstfix.native._{name}") for name in choice.runnable()]


def alike(name: str, *arguments: object) -> object:
    """The result of a kernel, after all instruction sets have given the same bytes."""
    first, *others = [getattr(module, name)(*arguments) for module in KERNELS]
    for other in others:
        np.testing.assert_equal(other, first)
    return first


def reference(name: str, *arguments: object) -> object:
    with np.errstate(all="ignore"):  # points that are not finite are in no cell
        return REFERENCES[name](*arguments)


@st.composite
def grids(draw: st.DrawFn) -> tuple[int, int, float, np.ndarray]:
    """Rings, sectors, range, and edges of 1 to 16 layers."""
    rings, sectors = draw(st.integers(1, 200)), draw(SECTORS)
    step_m = draw(st.sampled_from([0.25, 0.3, 1.1]))
    edges_m = 0.2 + step_m * np.arange(draw(st.integers(1, 16)) + 1)
    return rings, sectors, draw(st.sampled_from([0.5, 20.0, 60.0, 77.7])), edges_m.astype(np.float32)


def points_of(grid: tuple[int, int, float, np.ndarray], seed: int, count: int) -> np.ndarray:
    """Points inside and outside, on the borders of rings, sectors and layers, and some not finite."""
    rings, sectors, range_m, edges_m = grid
    rng = np.random.default_rng(seed)
    points = rng.normal(0, 1, (count, 3)) * [range_m / 2, range_m / 2, 3]
    on_border = rng.random(count) < 0.5
    ring, sector = rng.integers(0, rings + 2, count), rng.integers(0, sectors + 1, count)
    angle = sector * (2 * np.pi / sectors)
    border = np.stack([np.cos(angle), np.sin(angle)]) * ring * range_m / rings
    points[on_border, :2] = border.T[on_border]
    points[:, 2] = np.where(
        rng.random(count) < 0.5, rng.choice(edges_m, count) - np.float32(1.5), points[:, 2]
    )
    odd = rng.random((count, 3)) < 0.01
    points[odd] = rng.choice([np.nan, np.inf, -np.inf, 3e38, -0.0, 0.0], odd.sum())
    return points.astype(np.float32)


@given(grids(), st.integers(0, 1000), st.lists(st.sampled_from([0, 1, 3, 40, 700]), max_size=4))
@settings(max_examples=60, deadline=None)
def test_the_same_cells_are_filled(grid: tuple[int, int, float, np.ndarray], seed: int, counts: list[int]):
    start = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)]).astype(np.int64)
    points = points_of(grid, seed, int(start[-1]))
    height_m = np.random.default_rng(seed).choice([0.0, 1.5, 1.7], len(counts)).astype(np.float32)
    arguments = (points, start, height_m, *grid)
    found = alike("occupied_cells", *arguments)
    np.testing.assert_array_equal(found, reference("occupied_cells", *arguments))
    turned = levelling_rotation(np.random.default_rng(seed).normal(0, 1, 3))
    levelled = reference("turned", points, turned)
    expected = reference("occupied_cells", levelled, np.array([0, len(points)]), np.float32([1.5]), *grid)
    np.testing.assert_array_equal(alike("turned_occupied_cells", points, turned, 1.5, *grid), expected)


def test_recorded_scans_fill_the_same_cells():
    for path in sorted(recorded(STREET).glob("*.pcd"))[:3]:
        points = read_scan_file(path).points
        grid = (20, 60, 60.0, np.float32(EDGES_M))
        R = levelling_rotation(np.array([0.02, -0.03, 1.0]))
        one = np.array([0, len(points)])
        expected = reference("occupied_cells", reference("turned", points, R), one, np.float32([1.7]), *grid)
        assert np.unpackbits(expected).sum() > 200
        np.testing.assert_array_equal(alike("turned_occupied_cells", points, R, 1.7, *grid), expected)


@given(st.integers(1, 80), SECTORS, st.integers(0, 1000), st.sampled_from([0.0, 0.004, 0.1, 0.4, 1.0]))
@settings(max_examples=60, deadline=None)
def test_the_same_shifts_are_best(rings: int, sectors: int, seed: int, filled: float):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 30))
    templates = np.packbits(rng.random((count, rings * sectors)) < rng.random((count, 1)) ** 2, axis=1)
    templates[:, -1] |= np.uint8(rng.integers(0, 1 << (-rings * sectors % 8)))  # bits of no cell
    query = np.packbits(rng.random(rings * sectors) < filled)
    turned = np.roll(
        np.unpackbits(query, count=rings * sectors).reshape(rings, sectors), sectors // 3, axis=1
    )
    templates[0] = np.packbits(turned.reshape(-1))
    rows = rng.integers(0, count, int(rng.integers(0, 40)))
    shift, score = alike("best_shifts", query, templates, rows, rings, sectors)
    expected_shift, expected_score = reference("best_shifts", query, templates, rows, rings, sectors)
    np.testing.assert_array_equal(shift, expected_shift)
    np.testing.assert_array_equal(score, expected_score)
    assert score.dtype == expected_score.dtype


@given(st.integers(1, 80), SECTORS, st.integers(1, 30), st.integers(0, 1000))
@settings(max_examples=40, deadline=None)
def test_spectra_are_those_of_numpy(rings: int, sectors: int, coefficients: int, seed: int):
    rng = np.random.default_rng(seed)
    cells = rng.random((4, rings * sectors)) < rng.random((4, 1))
    cells[0] = False
    occupancy = np.packbits(cells, axis=1)
    keys = alike("ring_spectra", occupancy, rings, sectors, coefficients)
    expected = reference("ring_spectra", occupancy, rings, sectors, coefficients)
    assert keys.shape == expected.shape
    assert keys.dtype == expected.dtype
    np.testing.assert_allclose(keys, expected, atol=1e-6)
    assert not keys[0].any()
    np.testing.assert_allclose(np.linalg.norm(keys[cells.any(axis=1)], axis=1), 1, atol=1e-6)


@given(st.integers(0, 1000), st.integers(0, 80), st.integers(1, 20), st.integers(1, 3))
@settings(max_examples=40, deadline=None)
def test_poses_are_spread_out(seed: int, count: int, at_most: int, a_spot: int):
    rng = np.random.default_rng(seed)
    position_m = rng.integers(0, 7, (count, 3)) * [1.0, 1.0, 0.2]  # many just two metres apart
    yaw_rad = rng.integers(0, 360, count) * (2 * np.pi / 360)
    how = (at_most, 2.0, float(np.cos(np.radians(20.0))), a_spot)
    assert alike("spread_out", position_m, yaw_rad, *how).tolist() == spread_out(position_m, yaw_rad, *how)


@given(st.integers(0, 1000), st.integers(1, 150), st.integers(1, 20), st.integers(1, 7), st.integers(0, 4))
@settings(max_examples=60, deadline=None)
def test_the_nearest_keys_of_some_lists(seed: int, known: int, numbers: int, lists: int, probes: int):
    rng = np.random.default_rng(seed)
    keys = rng.integers(-3, 4, (known, numbers)).astype(np.float32)  # many are equally far
    start = np.sort(np.append(rng.integers(0, known + 1, lists - 1), [0, known]))
    asked = rng.integers(-3, 4, (11, numbers)).astype(np.float32)
    probed = np.array([rng.permutation(lists)[:probes] for _ in asked], np.int64)
    most = int(rng.integers(1, known + 1))
    found = native.nearest_in_lists(asked, probed, keys, start, most)
    for query, own, rows in zip(asked, probed, found.tolist(), strict=True):
        there = np.concatenate([np.arange(start[i], start[i + 1]) for i in np.sort(own)] or [[]]).astype(int)
        nearest = there[np.argsort(((keys[there] - query) ** 2).sum(axis=1), kind="stable")][:most]
        assert rows == nearest.tolist() + [-1] * (most - len(nearest))


POINTS, HEIGHT = np.zeros((5, 3), np.float32), np.zeros(2, np.float32)
GRID = (2, 8, 10.0, np.float32([0, 1]))
CELLS = np.zeros((3, 2), np.uint8)


@every_case(
    ("start", "grid"),
    [
        ([0, 5], GRID),
        ([0, 2, 6], GRID),
        ([-1, 2, 5], GRID),
        ([0, 4, 3], GRID),
        ([0, 2, 5], (0, 8, 10.0, np.float32([0, 1]))),
        ([0, 2, 5], (2, 0, 10.0, np.float32([0, 1]))),
        ([0, 2, 5], (1 << 40, 1 << 40, 10.0, np.float32([0, 1]))),
        ([0, 2, 5], (2, 8, 0.0, np.float32([0, 1]))),
        ([0, 2, 5], (2, 8, np.nan, np.float32([0, 1]))),
        ([0, 2, 5], (2, 8, 10.0, np.float32([0]))),
        ([0, 2, 5], (2, 8, 10.0, np.float32([]))),
        ([0, 2, 5], (2, 8, 10.0, np.float32([1, 0]))),
        ([0, 2, 5], (2, 8, 10.0, np.float32([0, np.nan]))),
    ],
)
def test_scans_and_grids_that_do_not_fit_are_refused(start: list[int], grid: tuple[object, ...]):
    with pytest.raises(ValueError, match=r"out of range|do not|too few or too many|at least"):
        native.occupied_cells(POINTS, np.array(start), HEIGHT, *grid)


@every_case(
    ("query", "templates", "rows", "rings", "sectors"),
    [
        (CELLS[0], CELLS, [3], 2, 8),
        (CELLS[0], CELLS, [0, -1], 2, 8),
        (CELLS[0], CELLS[:0], [0], 2, 8),
        (CELLS[0, :1], CELLS, [0], 2, 8),
        (CELLS[0], CELLS, [0], 3, 8),
        (CELLS[0], CELLS, [0], 1, 8),
        (CELLS[0], CELLS, [0], 0, 8),
        (CELLS[0], CELLS, [0], 2, 0),
        (CELLS[0], CELLS, [0], 1 << 40, 1 << 40),
    ],
)
def test_occupancies_and_rows_that_do_not_fit_are_refused(query, templates, rows, rings, sectors):
    with pytest.raises(ValueError, match=r"out of range|another number of cells|too few or too many"):
        native.best_shifts(query, templates, np.array(rows), rings, sectors)
    if rings * sectors != 16:
        with pytest.raises(ValueError, match=r"another number of cells|too few or too many"):
            native.ring_spectra(templates, rings, sectors, 8)


def test_templates_are_never_copied():
    for templates in (CELLS.astype(np.float32), np.asfortranarray(CELLS)):
        with pytest.raises(TypeError):
            native.best_shifts(CELLS[0], templates, np.array([0]), 2, 8)


def test_a_memory_mapped_file_is_read(tmp_path: Path):
    np.save(tmp_path / "cells.npy", np.full((3, 2), 255, np.uint8))
    mapped = np.load(tmp_path / "cells.npy", mmap_mode="r")
    _, score = native.best_shifts(np.full(2, 255, np.uint8), mapped, np.array([2]), 2, 8)
    assert score.tolist() == [1]
