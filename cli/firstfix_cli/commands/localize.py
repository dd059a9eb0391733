"""``firstfix localize``: find the pose of a scan, or of every cloud in a bag."""

from __future__ import annotations

import json
from collections.abc import Iterable
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..arguments import (
    AsJson,
    Columns,
    MapId,
    SentAs,
    Store,
    TimeoutS,
    Url,
    Zenoh,
    columns_of,
    examples,
)

if TYPE_CHECKING:
    from firstfix.answer.hint import Hint
    from firstfix.answer.localization import Localization
    from firstfix.scan.sequence import ScanSequence
    from firstfix.transform import Matrix

    from ..bags.replay import Replayed

SHOWN_PLACES = 3
_ALSO_HELPS = ("no_times", "time_field_unknown")
EXIT_CODES = {"localized": 0, "ambiguous": 3, "rejected": 4}


EXAMPLES = examples(
    "firstfix localize scan.pcd --map hall",
    "firstfix localize scan.pcd --map hall --gravity 0,0,-1 --json",
    "firstfix localize --bag drive.mcap --map hall --every 10 --tum fixes.txt",
    "firstfix localize --bag drive --map hall --topic /front/points --topic /rear/points",
)


def localize(
    map_id: MapId,
    scan: Annotated[
        Path | None, typer.Argument(help="Scan file: .pcd, .ply, .bin, .npy, .xyz, .laz, .ffscan ...")
    ] = None,
    url: Url = None,
    zenoh: Zenoh = None,
    store: Store = None,
    gravity: Annotated[
        str | None,
        typer.Option(
            help="Direction of gravity in the sensor frame: x,y,z (down) or roll_deg,pitch_deg. An IMU at "
            "rest reports the opposite, +9.81 upwards: give its negative."
        ),
    ] = None,
    base_sensor: Annotated[
        str | None,
        typer.Option("--T-base-sensor", metavar="X,Y,Z,QX,QY,QZ,QW", help="Pose of the sensor on the robot."),
    ] = None,
    prior: Annotated[
        str | None,
        typer.Option(help="Where the robot is known to be: x,y,z,radius_m[,yaw_deg,yaw_range_deg]."),
    ] = None,
    max_candidates: Annotated[
        int | None, typer.Option(help="Limit on the candidate poses that are tried.")
    ] = None,
    min_probability: Annotated[
        float | None, typer.Option(help="Probability below which the scan is not localized.")
    ] = None,
    max_false_accept: Annotated[
        float | None,
        typer.Option(
            help="Instead of --min-probability: largest share of scans from elsewhere that may be localized."
        ),
    ] = None,
    version: Annotated[
        str | None, typer.Option(help="Map version, 64 characters [default: the active one].")
    ] = None,
    twist: Annotated[
        str | None,
        typer.Option(
            metavar="VX,VY,VZ,WX,WY,WZ",
            help="Motion of the sensor during the scan, in m/s and rad/s [default: solved with the pose, "
            "where the times of the points are known].",
        ),
    ] = None,
    columns: Columns = None,
    encoding: SentAs = "scan",
    timeout_s: TimeoutS = 30.0,
    as_json: AsJson = False,
    odometry: Annotated[
        Path | None,
        typer.Option(
            metavar="POSES.csv",
            help="Instead of SCAN: up to 16 scans with their odometry poses, in a CSV file as for evaluate. "
            "The answer is the pose of the last scan.",
        ),
    ] = None,
    bag: Annotated[
        Path | None,
        typer.Option(
            help="Instead of SCAN: a ROS 1 .bag, a ROS 2 .mcap or .db3, also with .zstd, the folder of a "
            "ROS 2 bag, a LiDAR's .pcap or .osf."
        ),
    ] = None,
    topics: Annotated[
        list[str] | None,
        typer.Option(
            "--topic",
            help="With --bag: topic of the clouds [default: the only one]. Several: LiDARs of "
            "one robot, whose clouds are merged to one scan in the first one's frame.",
        ),
    ] = None,
    every: Annotated[int, typer.Option(help="With --bag: use every n-th cloud.", min=1)] = 1,
    start: Annotated[float, typer.Option(help="With --bag: seconds to skip at the start.", min=0)] = 0.0,
    count: Annotated[
        int | None, typer.Option(help="With --bag: limit on the number of clouds.", min=1)
    ] = None,
    imu_topic: Annotated[
        str | None, typer.Option(help="With --bag: topic of the Imu messages that give gravity.")
    ] = None,
    base_frame: Annotated[
        str | None,
        typer.Option(
            help="With --bag: the robot's base frame. The sensor's mounting is read from /tf_static."
        ),
    ] = None,
    tf_static: Annotated[
        str | None,
        typer.Option(help="With --bag: topic of the fixed frames [default: every topic named tf_static]."),
    ] = None,
    tum: Annotated[
        Path | None, typer.Option(help="With --bag: write the poses to this file as a TUM trajectory.")
    ] = None,
) -> None:
    """Find the pose of a scan in a map.

    Instead of one scan it takes several with odometry (--odometry), or every cloud of a ROS bag (--bag).

    Exit codes: 0 localized, 1 no answer, 2 error, 3 ambiguous, 4 rejected; for a bag, by the best verdict.
    """
    from firstfix.answer.options import LocalizeOptions
    from firstfix.errors import InvalidOption

    from ..answerer import answerer
    from ..bags.replay import Replay, replay
    from ..limited_reader import limited_memory, read_scan

    if sum(one is not None for one in (scan, odometry, bag)) != 1:
        raise InvalidOption("give one of SCAN, --odometry and --bag")
    of_a_bag = Replay(
        bag or Path(), tuple(topics or ()), every, start, count, imu_topic, base_frame, tf_static
    )
    if bag is None and (of_a_bag != Replay(Path()) or tum is not None):
        raise InvalidOption(
            "--topic, --every, --start, --count, --imu-topic, --base-frame, --tf-static and --tum need --bag"
        )

    given = {
        "gravity": gravity,
        "prior": prior,
        "T_base_sensor": base_sensor,
        "max_candidates": max_candidates,
        "min_probability": min_probability,
        "max_false_accept": max_false_accept,
        "version": version,
        "twist": twist,
    }
    options = LocalizeOptions.from_strings({k: str(v) for k, v in given.items() if v is not None})
    with answerer(map_id, url=url, zenoh=zenoh, store=store, timeout_s=timeout_s, encoding=encoding) as ask:
        if bag is not None:
            answers = replay(of_a_bag, ask, options, lambda line: typer.echo(line, err=True))
            with limited_memory():
                verdicts = _print_replay(answers, tum, as_json)
            raise typer.Exit(min(EXIT_CODES[verdict] for verdict in verdicts))
        asked = _sequence(odometry, columns) if scan is None else read_scan(scan, columns_of(columns))
        answer = ask(asked, options)
    if as_json:
        typer.echo(json.dumps(answer.to_mapping()))
    else:
        typer.echo("\n".join(lines_of(answer)))
    raise typer.Exit(EXIT_CODES[answer.verdict.value])


def _sequence(path: Path | None, columns: str | None) -> ScanSequence:
    from firstfix.errors import MalformedData
    from firstfix.scan.sequence import MAX_SCANS, ScanSequence

    from ..limited_reader import read_scan
    from ..poses_csv import read_poses_csv

    assert path is not None
    rows = read_poses_csv(path)
    poses = [row.T_map_sensor for row in rows if row.T_map_sensor is not None]
    if len(poses) < len(rows):
        raise MalformedData(f"{path}: every scan needs its odometry pose")
    if len(rows) > MAX_SCANS:  # before they are read
        raise MalformedData(f"{path}: a query can hold up to {MAX_SCANS} scans, not {len(rows)}")
    names = columns_of(columns)
    return ScanSequence.along([read_scan(row.path, names) for row in rows], poses)


def _print_replay(answers: Iterable[Replayed], tum: Path | None, as_json: bool) -> set[str]:
    """Print one line for each answer as it comes. Returns the verdicts."""
    from ..bags.replay import write_tum

    verdicts = set()
    if tum is not None:
        tum.parent.mkdir(parents=True, exist_ok=True)
    with nullcontext() if tum is None else tum.open("w") as trajectory:
        for one in answers:
            stamp, answer = one.header.stamp, one.answer
            verdicts.add(answer.verdict.value)
            if trajectory is not None:
                write_tum(trajectory, one)
            if as_json:
                said = {
                    "stamp": {"sec": stamp.sec, "nanosec": stamp.nanosec},
                    "frame_id": one.header.frame_id,
                }
                typer.echo(json.dumps(said | answer.to_mapping()))
            else:
                T = answer.T_map_sensor if answer.T_map_base is None else answer.T_map_base
                typer.echo(f"{stamp}  {_verdict_of(answer)}" + ("" if T is None else f"  {_place(T)}"))
    return verdicts


def lines_of(answer: Localization) -> list[str]:
    """The answer as text."""
    import numpy as np

    lines = [_verdict_of(answer)]
    if answer.T_map_sensor is not None:
        lines.append(f"  sensor  {_place(answer.T_map_sensor)}")
    if answer.T_map_base is not None:
        lines.append(f"  base    {_place(answer.T_map_base)}")
    if answer.covariance is not None:
        sigma = np.sqrt(np.diag(answer.covariance))
        lines.append(f"  sigma   {sigma[:3].max() * 1000:.1f} mm, {np.degrees(sigma[3:]).max():.3f} deg")
    for finding in answer.findings:
        lines.append(f"  {finding.severity.value:<7} {finding.text}")
    for number, finding in enumerate(answer.findings):
        if number == 0 or finding.code in _ALSO_HELPS:  # the others are what the first one causes
            lines.append(f"  remedy  {finding.remedy} ({finding.doc})")
    if answer.T_map_sensor is None:
        for h in answer.hypotheses[:SHOWN_PLACES]:
            lines.append(f"  maybe   {_place(h.T_map_sensor)}  probability {h.probability:.2f}")
        others = len(answer.hypotheses) - SHOWN_PLACES
        if others > 0:
            lines.append(f"          and {others} more places (--json has all)")
    if answer.hint is not None:
        lines.append(f"  next    {_move(answer.hint)}, and ask again with both scans")
    note = " (provisional)" if answer.map_provisional else ""
    lines.append(f"  map     {answer.map_id or '?'}, version {answer.map_version[:12] or '?'}{note}")
    if answer.timings_ms:
        stages = ", ".join(f"{stage} {ms:.1f}" for stage, ms in answer.timings_ms.items())
        lines.append(f"  ms      {stages}")
    return lines


def _verdict_of(answer: Localization) -> str:
    why = f" ({', '.join(reason.value for reason in answer.reasons)})" if answer.reasons else ""
    return f"{answer.verdict.value}{why}, probability {answer.probability:.3f}"


def _move(hint: Hint) -> str:
    """The move that should tell the places apart, in words."""
    from math import atan2, degrees

    x, y = hint.T_sensor_goal[:2, 3]
    parts = []
    if hint.distance_m:
        direction_deg = degrees(atan2(y, x))
        parts.append(f"drive {hint.distance_m:.1f} m to {direction_deg:.0f} deg (0 ahead, 90 left)")
    if round(hint.turn_deg):
        side = "left" if hint.turn_deg > 0 else "right"
        parts.append(f"turn {abs(hint.turn_deg):.0f} deg to the {side}")
    return ", ".join(parts) or "stay there"


def _place(T: Matrix) -> str:
    from math import degrees

    from firstfix.transform import yaw_of

    x, y, z = T[:3, 3]
    return f"x {x:.3f}  y {y:.3f}  z {z:.3f} m  yaw {degrees(yaw_of(T)):.2f} deg"
