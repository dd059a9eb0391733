"""``firstfix evaluate``: measure accuracy on scans with known poses."""

from __future__ import annotations

import csv
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from firstfix_cli.arguments import SentAs, TimeoutS, Url, Zenoh, examples

from ..datasets.names import Dataset
from .dataset import Lidar

if TYPE_CHECKING:
    from firstfix.scan.scan import Scan
    from firstfix.transform import Matrix
    from firstfix_cli.answerer import Answerer
    from firstfix_cli.poses_csv import PosedScan

    from ..evaluation.outcome import Outcome

    AskedScan = tuple[str, Scan, Matrix | None]  # name, points, and the true pose if it was taken in this map

SEED = 0  # of the choice of scans
PICTURED_SCANS = 60  # kept for the picture, which shows a few of them


EXAMPLES = examples(
    "firstfix evaluate world/poses.csv --map office",
    "firstfix evaluate world/poses.csv --map office --store store --plot office.png",
    "firstfix evaluate --recorded s3://maps/firstfix --map office --json -",
    "firstfix evaluate nclt/2012-02-04 --dataset nclt --map nclt --random-yaw 0",
    "firstfix evaluate world/poses.csv --answers answers.csv",
)


def evaluate(
    map_id: Annotated[str | None, typer.Option("--map", help="Id of the map.")] = None,
    poses: Annotated[
        Path | None,
        typer.Argument(
            metavar="POSES.csv",
            help="CSV with columns scan,tx,ty,tz,qx,qy,qz,qw: scan file and true pose. With --dataset: the "
            "folder of a recording.",
        ),
    ] = None,
    dataset: Annotated[
        Dataset | None,
        typer.Option(
            help="POSES.csv is the folder of this public data set's recording, as its authors ship it."
        ),
    ] = None,
    lidar: Lidar = None,
    spacing_m: Annotated[
        float,
        typer.Option(
            "--spacing", help="With --dataset: metres. One scan by chance from each such square is asked."
        ),
    ] = 5.0,
    recorded: Annotated[
        str | None,
        typer.Option(
            metavar="STORE",
            help="Instead of POSES.csv: send the queries again that a service recorded in this store.",
        ),
    ] = None,
    answers: Annotated[
        Path | None,
        typer.Option(
            metavar="ANSWERS.csv",
            help="Ask nobody: score these answers of any system (lab/docs/benchmark-protocol.md).",
        ),
    ] = None,
    url: Url = None,
    zenoh: Zenoh = None,
    store: Annotated[
        str | None,
        typer.Option(
            help="Localize on this machine, with this object store; with --url or --zenoh: only for --plot."
        ),
    ] = None,
    random_yaw: Annotated[
        int | None, typer.Option(metavar="SEED", help="Rotate every scan by a random yaw.")
    ] = None,
    gravity_from_poses: Annotated[
        float | None,
        typer.Option(
            metavar="NOISE_DEG",
            help="Send the gravity of the true pose with each query, as an IMU would measure it. This is the "
            "standard deviation of its roll and pitch errors.",
        ),
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the figures to this file; -: print only the figures.")
    ] = None,
    details: Annotated[
        Path | None, typer.Option(help="Write one CSV row for each scan to this file.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw the map, true poses and answers to this PNG file.")
    ] = None,
    version: Annotated[
        str | None, typer.Option(help="Map version, 64 characters [default: the active one].")
    ] = None,
    encoding: SentAs = "scan",
    timeout_s: TimeoutS = 30.0,
    samples: Annotated[str | None, typer.Option(hidden=True, help="Gone: --recorded.")] = None,
) -> None:
    """Measure accuracy on scans with known poses.

    Prints success rates, the false accept rate and times. With --recorded it shows how the answers have
    changed since a service recorded the queries. With --answers it scores what another system answered.
    """
    from firstfix.errors import InvalidOption
    from firstfix_cli.answerer import answerer
    from firstfix_cli.poses_csv import read_poses_csv

    from ..evaluation.outcome import report_of

    if samples is not None:  # until 0.2
        raise InvalidOption("--samples is now: --recorded")
    if answers is not None:
        asks = map_id or recorded or dataset or lidar or url or zenoh or store or details or plot or version
        if poses is None or asks or random_yaw is not None or gravity_from_poses is not None:
            raise InvalidOption("--answers can only be used with POSES.csv and --json")
        _score(poses, answers, json_file)
        return
    if map_id is None:
        raise InvalidOption("give --map")
    if (poses is None) == (recorded is None):
        raise InvalidOption("give either POSES.csv or --recorded")
    if recorded is not None and dataset is not None:
        raise InvalidOption("--dataset needs the folder of a recording, not --recorded")
    if lidar is not None and dataset is None:
        raise InvalidOption("--lidar needs --dataset")
    if recorded is not None:
        altered = random_yaw is not None or gravity_from_poses is not None
        if zenoh or details or plot or altered or encoding != "scan":
            raise InvalidOption("--recorded can only be used with --url or --store, --version and --json")
        _replay(recorded, map_id, url, store, version, timeout_s, json_file)
        return
    assert poses is not None
    if dataset is None:
        rows = read_poses_csv(poses)
        count, asked_scans = len(rows), _of_files(rows)
    else:
        count, asked_scans = _of_dataset(dataset, poses, lidar, spacing_m)
    asked = None if url or zenoh else store
    with answerer(map_id, url=url, zenoh=zenoh, store=asked, timeout_s=timeout_s, encoding=encoding) as ask:
        outcomes, scans = _outcomes(count, asked_scans, ask, random_yaw, gravity_from_poses, version)
    report = report_of(outcomes)
    _print(_lines(report, outcomes), report, json_file)
    if details is not None:
        _write_details(details, outcomes)
    if plot is not None:
        _draw(plot, map_id, store, outcomes, scans, report)


def _score(cases: Path, answers: Path, json_file: Path | None) -> None:
    from ..score.answers_csv import score
    from ..score.lines import lines_of
    from ..score.metrics import report_of

    report = report_of(score(cases, answers))
    _print(lines_of(report), report, json_file)


def _replay(
    recorded: str,
    map_id: str,
    url: str | None,
    store: str | None,
    version: str | None,
    timeout_s: float,
    json_file: Path | None,
) -> None:
    from firstfix.catalog.recorded_queries import RecordedQueries
    from firstfix.errors import InvalidOption
    from firstfix.store.store import Store

    from ..evaluation.replay import body_answerer, lines_of, replay, report_of

    if url and store:
        raise InvalidOption("give only one of --url and --store")
    with body_answerer(map_id, url=url, store=store, timeout_s=timeout_s) as ask:
        replayed = list(replay(RecordedQueries(Store.open(recorded)), map_id, ask, version))
    _print(lines_of(replayed), report_of(replayed), json_file)


def _print(lines: list[str], report: dict[str, Any], json_file: Path | None) -> None:
    text = json.dumps(report, indent=1)
    if json_file == Path("-"):
        typer.echo(text)
        return
    typer.echo("\n".join(lines))
    if json_file is not None:
        json_file.write_text(f"{text}\n")


def _of_files(rows: list[PosedScan]) -> Iterator[AskedScan]:
    from firstfix_cli.limited_reader import read_scan

    for row in rows:
        yield str(row.path), read_scan(row.path), row.T_map_sensor


def _of_dataset(
    dataset: Dataset, folder: Path, lidar: str | None, spacing_m: float
) -> tuple[int, Iterator[AskedScan]]:
    """The number of scans to ask, one a place, and reads them one by one."""
    from ..datasets.datasets import open_dataset
    from ..datasets.recording import one_a_place

    recording = open_dataset(dataset, folder, lidar)
    for note in recording.notes:
        typer.echo(note, err=True)
    chosen = one_a_place(recording.T_map_sensor, spacing_m, SEED)
    typer.echo(
        f"{folder}: {len(chosen)} of {len(recording.stamps_ns)} scans, one from each {spacing_m:g} m square"
        + (f"; {recording.without_pose} have no true pose" if recording.without_pose else ""),
        err=True,
    )
    return len(chosen), ((each.name, each.scan, each.T_map_sensor) for each in recording.read(chosen))


def _outcomes(
    count: int,
    asked: Iterator[AskedScan],
    ask: Answerer,
    seed: int | None,
    gravity_noise_deg: float | None,
    version: str | None,
) -> tuple[list[Outcome], dict[str, Scan]]:
    """The outcome of every query, and scans for the picture."""
    from rich.console import Console
    from rich.progress import track

    from firstfix.answer.options import LocalizeOptions

    from ..evaluation.outcome import outcome_of, random_yaws, turned
    from ..evaluation.pose_gravity import gravity_at, imu_errors

    outcomes: list[Outcome] = []
    scans: dict[str, Scan] = {}
    yaws = random_yaws(count, seed)
    errors = imu_errors(count, gravity_noise_deg)
    steps = track(
        zip(asked, yaws, errors, strict=True),
        "localize",
        total=count,
        console=Console(stderr=True),
        transient=True,
    )
    for (name, as_recorded, T_map_recorded), yaw, error in steps:
        scan, T_map_sensor = turned(as_recorded, T_map_recorded, float(yaw))
        gravity = None if error is None else gravity_at(T_map_sensor, error)
        started = time.perf_counter()
        answer = ask(scan, LocalizeOptions(gravity=gravity, version=version))
        ms = (time.perf_counter() - started) * 1000
        outcomes.append(outcome_of(name, T_map_sensor, answer, ms))
        if len(scans) < PICTURED_SCANS:
            scans[name] = scan
    return outcomes, scans


def _lines(report: dict[str, Any], outcomes: list[Outcome]) -> list[str]:
    from ..evaluation.outcome import angle_shares

    verdicts = ", ".join(f"{count} {name}" for name, count in report["verdicts"].items())
    success = ", ".join(f"{report[key]:.1%} within {key[8:]}" for key in report if key.startswith("success_"))
    angles = ", ".join(f"{share:.1%} within {limit}" for limit, share in angle_shares(outcomes).items())
    median = "no localized scan has a true pose"
    if report["median_error_m"] is not None:
        median = f"{report['median_error_m']:.3f} m, {report['median_error_deg']:.2f} deg"
    return [
        f"{report['n']} scans: {verdicts}",
        f"  position (yaw within 5 deg)  {success}",
        f"  yaw (position within 1 m)    {angles}",
        f"  true place (within 0.2 m)    {report['first_0.2m']:.1%} ranked first, "
        f"{report['among_0.2m']:.1%} among the hypotheses",
        f"  median error                 {median}",
        f"  false among localized        {report['false_accept_rate']:.1%}",
        f"  over 0.2 m among localized   {report['wrong_0.2m_rate']:.1%}",
        f"  ms                           {', '.join(f'{k} {v:.0f}' for k, v in report['ms'].items())}",
    ]


def _write_details(path: Path, outcomes: list[Outcome]) -> None:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            ["scan", "verdict", "reasons", "probability", "error_m", "error_deg", "yaw_error_deg", "ms"]
            + ["first_error_m", "among_error_m"]
        )
        for o in outcomes:
            reasons = "+".join(reason.value for reason in o.answer.reasons)
            numbers = [o.answer.probability, o.error_m, o.error_deg, o.yaw_error_deg, o.ms]
            numbers += [o.first_error_m, o.among_error_m]
            writer.writerow([o.name, o.answer.verdict.value, reasons, *(f"{v:.4f}" for v in numbers)])


def _draw(
    path: Path,
    map_id: str,
    store: str | None,
    outcomes: list[Outcome],
    scans: dict[str, Scan],
    report: dict[str, Any],
) -> None:
    from firstfix_cli.answerer import fetch_active_version

    from ..evaluation.plot import MapPicture, draw

    picture = None
    if store is not None:
        used = next((o.answer.map_version for o in outcomes if o.answer.map_version), None)
        picture = MapPicture.load(fetch_active_version(store, map_id, used)[1])
    draw(path, map_id, picture, outcomes, scans, report)
    typer.echo(f"  picture                      {path}", err=True)
