"""Compact scans, and several scans along a way, are localized on board as by a service."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.options import LocalizeOptions
from firstfix.bit_exact.sample import rows_by_chance
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.errors import InvalidScan
from firstfix.scan.condense import condense, describe
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.scan.scan import Scan
from firstfix.transform import from_quaternion
from firstfix.wire.query import decode_query, encode_query
from firstfix.wire.sequence import decode_scans, encode_scans
from tests.cpp.cpp_build import Build
from tests.cpp.printed_answers import (
    EXIT_CODES,
    PROGRAM,
    UNEXPLAINED,
    in_time,
    noise,
    printed,
    same,
    upside_down,
)


def parameters_of(folder: Path) -> DescriptorParameters:
    return DescriptorParameters.from_engine(json.loads((folder / "engine.json").read_bytes()))


def ways(small_scans) -> dict[str, tuple[list[Scan], list[np.ndarray]]]:
    """Scans that were taken from near each other, with poses of an odometry that drifts and stands askew."""
    at = np.array([T[:3, 3] for _, T in small_scans])
    T_odom_map = from_quaternion([3.0, -8.0, 0.5], [0.02, -0.01, 0.5, 0.8])
    near = np.argsort(np.linalg.norm(at - at[0], axis=1))[:3]
    scans = [small_scans[number][0] for number in near]
    poses = [T_odom_map @ small_scans[number][1] for number in near]
    return {
        "two": (scans[:2], poses[:2]),
        "three, the last one of few points": ([*scans[:2], Scan(scans[2].points[:20])], poses),
        "three, the last one in time": ([scans[2], scans[1], in_time(scans[0])], poses[::-1]),
        "from one spot": ([scans[0]] * 2, [poses[0]] * 2),
        "noise": ([noise(scans[0]), noise(scans[1])], poses[:2]),
        "upside down": ([upside_down(scan) for scan in scans[:2]], [poses[0]] * 2),
    }


def thinned(scan: Scan, points: int) -> Scan:
    rows = rows_by_chance(len(scan), points)
    return Scan(scan.points[rows], time_s=None if scan.time_s is None else scan.time_s[rows])


@pytest.mark.parametrize("form", ["whole", "compact"])
def test_scans_along_a_way_are_answered_as_by_a_service(
    on_board: Build, folder: Path, small_scans, tmp_path: Path, form: str
):
    localizer = Localizer(MapIndex.load(folder), explains=False)
    path, verdicts = tmp_path / "way.ffscan", set()
    for name, (scans, poses) in ways(small_scans).items():
        sent = [condense(scan) for scan in scans] if form == "compact" else scans
        body = encode_scans(sent, poses)
        path.write_bytes(body)
        up, at = poses[-1][2, :3], small_scans[0][1][:3, 3]
        for options in (
            {},
            {"gravity": ",".join(repr(float(-v)) for v in up)},
            {"prior": ",".join(repr(float(v)) for v in (*at, 4.0))},
            {"twist": "0.3,0,0,0,0,0.2"} if name.endswith("in time") else {"max_candidates": "5"},
        ):
            answer = localizer.localize(decode_scans(body), LocalizeOptions.from_strings(options))
            done = on_board.run(
                PROGRAM, folder, path, UNEXPLAINED, *(f"{key}={value}" for key, value in options.items())
            )
            assert same(printed(done), answer), (name, options)
            verdicts.add(answer.verdict.value)
    assert verdicts >= {"localized", "rejected"}


def test_compact_scans_are_answered_as_by_a_service(
    on_board: Build, folder: Path, small_scans, tmp_path: Path
):
    localizer = Localizer(MapIndex.load(folder), explains=False)
    parameters = parameters_of(folder)
    path, localized = tmp_path / "compact.ffscan", 0
    for scan, _ in small_scans[:3]:
        for number, compact in enumerate(
            (condense(scan), condense(scan, parameters), condense(in_time(scan)))
        ):
            body = encode_query(compact)
            path.write_bytes(body)
            for options in ({}, {"twist": "0.3,0,0,0,0,0.2"} if number == 2 else {"max_candidates": "5"}):
                answer = localizer.localize(decode_query(body), LocalizeOptions.from_strings(options))
                done = on_board.run(
                    PROGRAM, folder, path, UNEXPLAINED, *(f"{key}={value}" for key, value in options.items())
                )
                assert same(printed(done), answer), (number, options)
                localized += answer.verdict.value == "localized"
    assert localized >= 3


@pytest.mark.slow
def test_several_scans_are_not_read_beyond_their_ends(
    on_board: Build, sanitised_on_board: Build, folder: Path, small_scans, tmp_path: Path
):
    """Ways, whole and compact, thinned, under sanitizers: no optimisation shows in the answer either."""
    path = tmp_path / "way.ffscan"
    for name, (scans, poses) in ways(small_scans).items():
        some = [thinned(scan, 1500) for scan in scans]
        twist = ("twist=0.3,0,0,0,0,0.2",) if name.endswith("in time") else ()
        for sent in (some, [condense(scan) for scan in some]):
            path.write_bytes(encode_scans(sent, poses))
            asked = (PROGRAM, folder, path, UNEXPLAINED, "max_candidates=2", "prior=0,0,0,30", *twist)
            done = sanitised_on_board.run(*asked)
            assert done.returncode in EXIT_CODES.values(), (name, done.stderr)
            assert done.stdout == on_board.run(*asked).stdout, name


def test_poses_of_an_odometry_have_the_limits_of_a_service(
    on_board: Build, folder: Path, small_scans, tmp_path: Path
):
    """A pose that is too far from its frame's origin, from the last one, or no pose."""
    scan, path = small_scans[0][0], tmp_path / "way.ffscan"
    poses = [np.eye(4), np.eye(4)]
    poses[0][:3, 3], poses[1][:3, 3] = (1.25, 2.25, 3.25), (4.25, 5.25, 6.25)
    body = encode_scans([scan, scan], poses)
    for changes, says in (
        ({}, None),
        ({1.25: 1.5e8}, "pose 0 of the sequence lies beyond 1e.08 m"),
        ({1.25: 1e8, 4.25: 1e8}, None),
        ({1.25: -1.5e8, 4.25: -1.5e8}, "pose 0"),
        ({5.25: 1.1e8, 2.25: 1.1e8}, "pose 0"),
        ({3.25: 1e308, 6.25: 1e308}, "pose 0"),
        ({1.25: 1010.0}, "over 1000 m from the last"),
        ({6.25: 1e7}, "over 1000 m from the last"),
    ):
        changed = body
        for one, other in changes.items():
            assert body.count(struct.pack("<d", one)) == 1
            changed = changed.replace(struct.pack("<d", one), struct.pack("<d", other))
        path.write_bytes(changed)
        done = on_board.run(PROGRAM, folder, path)
        if says is None:
            decode_scans(changed)
            assert done.returncode in EXIT_CODES.values(), done.stderr
            continue
        with pytest.raises(InvalidScan, match=says) as refused:
            decode_scans(changed)
        assert (done.returncode, done.stderr) == (1, f"{PROGRAM}: invalid_scan: {refused.value}\n"), changes


def test_a_descriptor_alone_is_for_a_service(on_board: Build, folder: Path, small_scans, tmp_path: Path):
    path = tmp_path / "alone.ffscan"
    path.write_bytes(encode_query(describe(small_scans[0][0], parameters_of(folder))))
    assert "unsupported_format: a descriptor has no points" in on_board.run(PROGRAM, folder, path).stderr
