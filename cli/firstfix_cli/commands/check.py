"""``firstfix check``: what is wrong with a map and with scans, in seconds and without a build."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from firstfix.errors import FirstfixError

from ..arguments import AsJson, Columns, columns_of, examples
from ..finding_lines import finding_lines
from ..help_pages import scan_help_line
from ..map_facts import read_lines, what_was_read
from ..missing_package import missing_package
from .build import Axis

if TYPE_CHECKING:
    from firstfix.findings.finding import Finding
    from firstfix_builder.sources.read_map import MapData

    from ..bags.first_clouds import FirstCloud

EXAMPLES = examples(
    "firstfix check hall.ply",
    "firstfix check hall.ply scan.pcd --trajectory poses.txt",
    "firstfix check hall.laz --scale 0.001",
    "firstfix check --scans scan.pcd drive.mcap",
)
UNFIT_EXIT_CODE = 2


def check(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="MAP", help="Point cloud, mesh, folder of SLAM or of scans, or zip archive of one."
        ),
    ],
    scans: Annotated[
        list[Path] | None, typer.Argument(metavar="SCAN...", help="Scans, as for localize.")
    ] = None,
    trajectory: Annotated[
        Path | None, typer.Option(help="Poses of the mapping run: TUM, KITTI or CSV file.")
    ] = None,
    axis: Annotated[Axis, typer.Option(help="Axis of the map file that points up.")] = Axis.z_up,
    scale: Annotated[
        float, typer.Option(help="Metres in one unit of the map file and its poses: 0.001 for millimetres.")
    ] = 1.0,
    mount_height: Annotated[
        float,
        typer.Option(
            help="Metres of the sensor over the poses, where those are of the robot's base.",
            min=0,
        ),
    ] = 0.0,
    only_scans: Annotated[
        bool, typer.Option("--scans", help="All files are scans or recordings: there is no map.")
    ] = False,
    columns: Columns = None,
    as_json: AsJson = False,
) -> None:
    """Check a map, and scans, before a build.

    It reads them and looks for wrong units, axes, lost precision, doubled walls and floors, a trajectory in
    another frame and the like. Each finding comes with its remedy. Of a map it says what it read, of a scan
    what it understood: fields, times, beams, mounting. Nothing is built, stored or sent.

    A scan that cannot be read is told of, and the next ones are read.

    Exit codes: 0 nothing that prevents a build or a query, 2 something does.
    """
    paths = [source, *(scans or ())] if only_scans else scans or ()
    said = [] if only_scans else [_of_map(source, trajectory, axis, scale, mount_height)]
    for path in paths:
        try:
            said += _of_scans(path, columns)
        except (FirstfixError, ModuleNotFoundError) as error:  # of one file: the others are told of
            said.append(_unread(path, error))
    if as_json:
        typer.echo(json.dumps({"files": said}))
    else:
        typer.echo("\n".join(line for one in said for line in _lines(one)))
    errors = (finding["severity"] == "error" for one in said for finding in one["findings"])
    if any(errors) or any("error" in one for one in said):
        raise typer.Exit(UNFIT_EXIT_CODE)


def _of_map(
    source: Path, trajectory: Path | None, axis: Axis, scale: float, mount_height_m: float
) -> dict[str, Any]:
    from tempfile import TemporaryDirectory

    from firstfix.builds.config import BuildConfig
    from firstfix.errors import NoSuchFile
    from firstfix_builder.sources.check_map.check_map import check_map
    from firstfix_builder.sources.check_map.sensor_poses import with_sensor_poses
    from firstfix_builder.sources.check_map.shape import Shape
    from firstfix_builder.sources.read_map import read_map
    from firstfix_builder.sources.read_map.archive import SUFFIX, unpack

    BuildConfig.parse({"axis": axis.value, "scale": scale, "trajectory_mount_height_m": mount_height_m})
    if not source.exists():
        raise NoSuchFile(f"{source}: no such file")  # with its folder, which the reader leaves out
    with TemporaryDirectory() as scratch:
        is_packed = source.is_file() and source.suffix.lower() == SUFFIX
        read = unpack(source, Path(scratch) / "map") if is_packed else source
        data: MapData = read_map(read, axis=axis.value, scale=scale, trajectory=trajectory)
    data = with_sensor_poses(data, mount_height_m)
    findings = check_map(data, data.trajectory)
    shape = Shape.of(data)
    kind = "points" if data.points is not None else "vertices of a mesh"
    whole = f" (in all {shape.whole})" if shape.whole else ""
    facts = f"{len(data.coordinates):,} {kind}, {shape.words['extent']}{whole}{shape.words['spacing']}"
    return {**_record(source, facts, findings), "read": what_was_read(data, shape)}


def _of_scans(path: Path, columns: str | None) -> list[dict[str, Any]]:
    """One of a scan; of a recording, one of the first cloud of each topic."""
    from firstfix.recording.recording import is_recording

    if not (path.exists() and is_recording(path)):
        return [_of_scan(path, columns)]
    from ..bags.first_clouds import first_clouds

    return [_of_topic(path, found) for found in first_clouds(path)]


def _unread(path: Path, error: FirstfixError | ModuleNotFoundError) -> dict[str, Any]:
    """The record of a scan or a recording that cannot be read."""
    if isinstance(error, ModuleNotFoundError):
        code, text = "not_installed", missing_package(error)
    else:
        code, text = error.code, str(error).removeprefix(f"{path}: ")
    told = {"code": code, "message": text, "help": scan_help_line(error)}
    return {**_record(path, f"not read: {text}", []), "error": told}


def _of_topic(path: Path, found: FirstCloud) -> dict[str, Any]:
    from ..scan_report import report_of_cloud

    file = f"{path} {found.topic}"
    if found.stamped is None:
        return _record(Path(file), f"not read: {found.why}", [])
    stamped = found.stamped
    said = report_of_cloud(stamped.cloud, stamped.scan(), stamped.header.frame_id).to_mapping()
    notes = [*found.notes, *([stamped.note] if stamped.note else [])]
    if notes:
        said["understood"] = {"recording": "; ".join(notes), **said["understood"]}
    return {"file": file, **said}


def _of_scan(path: Path, columns: str | None) -> dict[str, Any]:
    from ..limited_reader import read_cloud, read_scan
    from ..scan_report import report_of_cloud

    names = columns_of(columns)
    is_sent = path.suffix.lower() == ".ffscan"  # its times are no column
    report = report_of_cloud(read_cloud(path, names), read_scan(path, names) if is_sent else None)
    return {"file": str(path), **report.to_mapping()}


def _record(path: Path, facts: str, findings: list[Finding]) -> dict[str, Any]:
    return {"file": str(path), "facts": facts, "findings": [one.to_mapping() for one in findings]}


def _lines(said: dict[str, Any]) -> list[str]:
    from firstfix.findings.finding import Finding

    if "error" in said:
        helped = said["error"]["help"]
        return [f"{said['file']}: {said['facts']}", *([f"  {helped}"] if helped else [])]
    found = finding_lines(Finding.from_mapping(one) for one in said["findings"])
    read = read_lines(said["read"]) if "read" in said else []
    understood = [
        f"{subject.replace('_', ' ')}: {text}" for subject, text in said.get("understood", {}).items()
    ]
    lines = [*read, *understood, *(found or ["nothing found"])]
    return [f"{said['file']}: {said['facts']}", *(f"  {line}" for line in lines)]
