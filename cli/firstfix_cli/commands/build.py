"""``firstfix build``: build a map version and publish it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer

from firstfix.builds.limits import DEFAULT_MAX_TEMPLATES
from firstfix.builds.options import BuildOptions
from firstfix.findings.finding import Finding

from ..arguments import AsJson, Url, cache_directory, examples
from ..build_report import kept_lines, reused_lines, self_test_lines
from ..finding_lines import finding_lines
from ..stage_bars import stage_progress

EXAMPLES = examples(
    "firstfix build hall.ply --map-id hall --store store",
    "firstfix build hall.ply --map-id hall --store store --sensor vlp-16 --trajectory poses.txt",
    "firstfix build hall.ply --map-id hall --url http://localhost:8080",
    "firstfix build monday.pcd --merge tuesday.pcd,tuesday.txt --map-id hall --store store",
)


class Axis(str, Enum):
    """Axis of the map file that points up."""

    z_up = "z-up"
    y_up = "y-up"


def build(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="MAP", help="Point cloud, mesh, folder of SLAM or of scans, or zip archive of one."
        ),
    ],
    map_id: Annotated[str, typer.Option(metavar="MAP", help="Id of the map: a-z, 0-9, _ and -.")],
    store: Annotated[
        str | None,
        typer.Option(
            metavar="STORE",
            help="Build on this machine and publish to this object store: a directory, s3://..., gs://... or "
            "az://... Without it, a service builds the map.",
        ),
    ] = None,
    url: Url = None,
    sensor: Annotated[
        str | None,
        typer.Option(metavar="MODEL", help="LiDAR model, or the path of a sensor YAML [default: os1-64]."),
    ] = None,
    trajectory: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Poses of the mapping run: TUM, KITTI or CSV file.")
    ] = None,
    merge: Annotated[
        list[str] | None,
        typer.Option(
            metavar="MAP[,TRAJECTORY]",
            help="A later session of the same place, which is aligned with MAP and merged. May be repeated.",
        ),
    ] = None,
    config: Annotated[Path | None, typer.Option(metavar="FILE", help="Build config, YAML or JSON.")] = None,
    axis: Annotated[Axis | None, typer.Option(help="Axis of the map file that points up.")] = None,
    scale: Annotated[
        float | None,
        typer.Option(help="Metres in one unit of the map file and its poses: 0.001 for millimetres."),
    ] = None,
    mount_height: Annotated[
        float | None,
        typer.Option(
            help="Metres of the sensor over the poses, where those are of the robot's base [default: 0].",
            min=0,
        ),
    ] = None,
    min_found: Annotated[
        float | None,
        typer.Option(
            help="Activate the version if the self-test found the places of this share of its scans "
            "[default: 0.7].",
            min=0,
            max=1,
        ),
    ] = None,
    min_localized: Annotated[float | None, typer.Option(hidden=True, help="Gone: --min-found.")] = None,
    exact: Annotated[
        bool,
        typer.Option(
            "--exact",
            help="Keep no learned keys and no calibration of the active version, however little has changed: "
            "to the last bit a build from nothing.",
        ),
    ] = False,
    work: Annotated[
        Path | None,
        typer.Option(help="With --store: folder for finished stages, so that a build can resume."),
    ] = None,
    executor: Annotated[
        str,
        typer.Option(
            metavar="threads|dask://HOST:PORT",
            help="With --store: run on this machine, or on a Dask cluster.",
        ),
    ] = "threads",
    max_templates: Annotated[
        int,
        typer.Option(
            envvar="FIRSTFIX_BUILD_MAX_TEMPLATES",
            help="With --store: a map of more templates, by an estimate, is refused; 0: none is.",
            min=0,
        ),
    ] = DEFAULT_MAX_TEMPLATES,
    note: Annotated[
        str, typer.Option(metavar="TEXT", help="A note for people, which is shown with the version.")
    ] = "",
    no_wait: Annotated[
        bool,
        typer.Option(
            "--no-wait", help="Do not wait for the service's build; print its id, for firstfix builds."
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Build a map version, test it and publish it.

    The new version becomes the active one, unless its self-test found the places of too few of its scans, or
    of clearly fewer than with the active version, or a finding of the map holds it back: then it is published
    only. With --store the build runs on this
    machine; otherwise a service does it, at --url. A folder with a sessions.yaml is merged from the
    sessions that the file lists.
    """
    from firstfix.builds.config import MIN_LOCALIZED_IS_GONE
    from firstfix.catalog.provenance import check_note
    from firstfix.errors import InvalidOption
    from firstfix.ids import check_map_id

    check_map_id(map_id)
    check_note(note)
    if min_localized is not None:
        raise InvalidOption(MIN_LOCALIZED_IS_GONE.format(old="--min-localized", new="--min-found"))
    if store is None:
        if work is not None:
            raise InvalidOption("--work needs --store")
        if executor != "threads":
            raise InvalidOption("--executor needs --store")
        from ..remote_build import remote_build

        given = _given(config, sensor, axis, scale, mount_height, min_found, exact=exact)
        with _source(source, trajectory, merge) as (whole, poses):
            said = remote_build(whole, map_id, given, poses, url, stage_progress, note=note, wait=not no_wait)
    else:
        if url is not None or no_wait:
            raise InvalidOption("--url and --no-wait cannot be used with --store")
        from ..local_build import local_build, made_of
        from ..read_confined import build_memory_bytes

        options = BuildOptions(
            store=store,
            work=(work or cache_directory("build")) / map_id,
            executor=executor,
            max_memory_bytes=build_memory_bytes(),
            max_templates=max_templates or None,
            log_level="critical",  # what went wrong is in the error
        )
        given = _given(config, sensor, axis, scale, mount_height, min_found, exact=exact)
        with _source(source, trajectory, merge) as (whole, poses):
            said = local_build(
                whole, map_id, given, poses, options, stage_progress, made_of(source, trajectory, note)
            )
    typer.echo(json.dumps(said) if as_json else "\n".join(_lines(said)))


@contextmanager
def _source(
    source: Path, trajectory: Path | None, merge: list[str] | None
) -> Iterator[tuple[Path, Path | None]]:
    """Yield the source and its trajectory; with sessions to merge, the folder that holds all of them."""
    from ..map_source import GivenSession, session_folder

    if not merge:
        yield source, trajectory
        return
    with session_folder([GivenSession(source, trajectory), *map(GivenSession.parse, merge)]) as folder:
        yield folder, None


def _given(
    path: Path | None,
    sensor: str | None,
    axis: Axis | None,
    scale: float | None = None,
    mount_height: float | None = None,
    min_found: float | None = None,
    *,
    exact: bool = False,
) -> dict[str, Any]:
    """The given config: the file, with the options of the command line put over it."""
    import yaml

    from firstfix.builds.config import BuildConfig
    from firstfix.errors import InvalidOption, NotFound

    values: dict[str, Any] = {}
    reading: object = path
    try:
        if path is not None:
            BuildConfig.from_file(path)  # its errors name the file
            values = yaml.safe_load(path.read_text()) or {}
        if axis is not None:
            values["axis"] = axis.value
        if scale is not None:
            values["scale"] = scale
        if mount_height is not None:
            values["trajectory_mount_height_m"] = mount_height
        if min_found is not None:
            values["activate"] = {**(values.get("activate") or {}), "min_found": min_found}
        if exact:
            values["exact"] = True
        if sensor is not None:
            reading = sensor
            is_file = sensor.endswith((".yaml", ".yml", ".json"))
            values["sensor"] = yaml.safe_load(Path(sensor).read_text()) if is_file else sensor
    except FileNotFoundError as error:
        raise NotFound(f"{error.filename}: no such file") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InvalidOption(f"{reading}: {error}") from None
    BuildConfig.parse(values)
    return values


def _lines(said: dict[str, Any]) -> list[str]:
    """The content of ``--json`` as text."""
    if "version" not in said:
        waits = [f"it waits: {said['waits_for']}"] if said["waits_for"] else []
        return [f"build {said['build_id']} of {said['map_id']} is {said['state']}", *waits]
    counts = ", ".join(f"{count:,} {name.replace('_', ' ')}" for name, count in said["counts"].items())
    size = f", {said['bytes'] / 1e6:,.0f} MB" if "bytes" in said else ""  # a service does not report it
    state = "" if said["activated"] else ", NOT ACTIVATED"
    return [
        f"published {said['map_id']}, version {said['version']}{state}",
        f"  {counts}{size}",
        *(f"  {line}" for line in self_test_lines(said["self_test"])),
        *(f"  {line}" for line in reused_lines(said["stages"])),
        *(f"  {line}" for line in kept_lines(said.get("rebuilt"))),
        *(f"  {line}" for line in finding_lines(map(Finding.from_mapping, said["findings"]))),
    ]
