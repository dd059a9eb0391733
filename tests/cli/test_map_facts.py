"""Lines of ``firstfix check`` about a map that it read."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from firstfix_builder.sources.check_map.shape import Shape
from firstfix_builder.sources.read_map.map_data import MapData
from firstfix_builder.sources.read_map.what_was_read import LeftOut, WhatWasRead
from firstfix_cli.map_facts import read_lines, what_was_read
from tests.commands import firstfix
from tests.needs import recorded


def box() -> np.ndarray:
    """Points on the sides of a box of 12 x 8 x 3 m, and a stray one 100 m away."""
    points = np.random.default_rng(5).uniform(0, 1, (20_000, 3)) * [12, 8, 3]
    side = np.arange(len(points)) % 5
    for number, (axis, at) in enumerate(((2, 0.0), (0, 0.0), (0, 12.0), (1, 0.0), (1, 8.0))):
        points[side == number, axis] = at
    points[0] = [100, 0, 0]
    return points


def test_the_lines_say_all_that_a_reader_told():
    read = WhatWasRead(
        form="LAS 1.4",
        program="Scanner 3",
        unit="US survey foot",
        georeference="EPSG:2927",
        clouds=tuple(f"{number}.las" for number in range(7)),
        poses="way.csv",
        left_out=(LeftOut("points", "marked as withheld", 3000),),
        notes=("Its tiles are 20 m wide.",),
    )
    points = box()
    data = MapData(points=points, trajectory=np.eye(4)[None], origin=np.array([4e5, 5e6, 0]), read=read)
    lines = read_lines(what_was_read(data, Shape.of(data)))
    assert lines == [
        "format: LAS 1.4, written by Scanner 3",
        "unit: US survey foot",
        "frame: EPSG:2927",
        "frame: large coordinates, around (400,000, 5,000,000)",
        "clouds: 0.las, 1.las, 2.las, 3.las, 4.las and 2 more",
        "poses: 1 of way.csv, of the map itself",
        "left out: 3,000 points (marked as withheld)",
        "Its tiles are 20 m wide.",
    ]
    assert read_lines(what_was_read(MapData(points=points), Shape.of(MapData(points=points)))) == [
        "poses: none"
    ]


def test_check_prints_what_was_read_and_both_extents(tmp_path: Path):
    np.save(tmp_path / "box.npy", box())
    (tmp_path / "way.txt").write_text("".join(f"{k} {2 + k} 4 0 0 0 0 1\n" for k in range(9)))
    command = ("check", str(tmp_path / "box.npy"), "--trajectory", str(tmp_path / "way.txt"))
    text = firstfix(*command).out
    assert "12 x 8 x 3 m (in all 100 x 8 x 3 m)" in text
    assert "poses: 9 of way.txt, given" in text
    assert "[trajectory_of_base]" in text
    said = json.loads(firstfix(*command, "--mount-height", "1", "--json").out)["files"][0]
    assert said["findings"] == []
    assert said["read"]["poses"] == 9
    assert said["read"]["whole_extent_m"][0] == pytest.approx(100, abs=0.1)


def test_check_of_a_recorded_hall_says_how_large_it_is_in_all():
    hall = recorded("hilti_hall_indoor/map_0.05m.laz")  # 35.5 x 63.4 x 11.7 m by laspy
    said = json.loads(firstfix("check", str(hall), "--json").out)["files"][0]
    assert said["read"]["whole_extent_m"] == pytest.approx([35.5, 63.4, 11.7], abs=0.1)
    assert "29 x 36 x 11 m (in all 35 x 63 x 12 m)" in said["facts"]
    assert said["findings"] == []


def test_check_of_a_recorded_scan_says_that_it_is_no_map():
    scan = recorded("hilti_hall_indoor/queries/scan_004.pcd")
    text = firstfix("check", str(scan)).out
    assert "This is a single scan, and no map. [map_single_scan]" in text
    assert "Give the map that your SLAM made of all scans." in text
