"""``firstfix build``: build a map version and publish it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from firstfix.builds.limits import DEFAULT_MAX_TEMPLATES
from firstfix.builds.options import PUBLISH, BuildOptions
from firstfix.findings.finding import Finding

from ..arguments import AsJson, Url, cache_directory, examples
from ..build_report import reused_lines, self_test_lines
from ..finding_lines import finding_lines

if TYPE_CHECKING:
    from firstfix.catalog.manifest import Manifest


CLUSTER_STAGES_S = 7 * 86400.0  # how long the inputs of a cluster's workers stay in the store


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
    map_id: Annotated[str, typer.Option(help="Id of the map: a-z, 0-9, _ and -.")],
    store: Annotated[
        str | None,
        typer.Option(
            help="Build on this machine and publish to this object store: a directory, s3://..., gs://... or "
            "az://... Without it, a service builds the map."
        ),
    ] = None,
    url: Url = None,
    sensor: Annotated[
        str | None, typer.Option(help="LiDAR model, or the path of a sensor YAML [default: os1-64].")
    ] = None,
    trajectory: Annotated[
        Path | None, typer.Option(help="Poses of the mapping run: TUM, KITTI or CSV file.")
    ] = None,
    merge: Annotated[
        list[str] | None,
        typer.Option(
            metavar="MAP[,TRAJECTORY]",
            help="A later session of the same place, which is aligned with MAP and merged. May be repeated.",
        ),
    ] = None,
    config: Annotated[Path | None, typer.Option(help="Build config, YAML or JSON.")] = None,
    axis: Annotated[Axis | None, typer.Option(help="Axis of the map file that points up.")] = None,
    scale: Annotated[
        float | None,
        typer.Option(help="Metres in one unit of the map file and its poses: 0.001 for millimetres."),
    ] = None,
    min_localized: Annotated[
        float | None,
        typer.Option(
            help="Activate the version if the self-test localized this share of its scans [default: 0.5].",
            min=0,
            max=1,
        ),
    ] = None,
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
    no_wait: Annotated[
        bool, typer.Option("--no-wait", help="Do not wait for the service's build; print its id.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Build a map version, test it and publish it.

    The new version becomes the active one, unless too few scans of its self-test were localized, or clearly
    fewer than with the active version: then it is published only. With --store the build runs on this
    machine; otherwise a service does it, at --url. A folder with a sessions.yaml is merged from the
    sessions that the file lists.
    """
    from firstfix.errors import InvalidOption
    from firstfix.ids import check_map_id

    check_map_id(map_id)
    if store is None:
        if work is not None:
            raise InvalidOption("--work needs --store")
        if executor != "threads":
            raise InvalidOption("--executor needs --store")
        from ..remote_build import remote_build

        given = _given(config, sensor, axis, scale, min_localized)
        with _source(source, trajectory, merge) as (whole, poses):
            said = remote_build(whole, map_id, given, poses, url, _progress, wait=not no_wait)
        typer.echo(json.dumps(said) if as_json else "\n".join(_lines(said)))
        return
    if url is not None or no_wait:
        raise InvalidOption("--url and --no-wait cannot be used with --store")
    from ..read_confined import build_memory_bytes

    given = _given(config, sensor, axis, scale, min_localized)
    with _source(source, trajectory, merge) as (whole, poses):
        options = BuildOptions(
            store=store,
            work=(work or cache_directory("build")) / map_id,
            executor=executor,
            max_memory_bytes=build_memory_bytes(),
            max_templates=max_templates or None,
            log_level="critical",  # what went wrong is in the error
        )
        _build_here(whole, map_id, given, poses, options, as_json)


@contextmanager
def _source(
    source: Path, trajectory: Path | None, merge: list[str] | None
) -> Iterator[tuple[Path, Path | None]]:
    """Yields the source and its trajectory; with sessions to merge, the folder that holds all of them."""
    from ..map_source import GivenSession, session_folder

    if not merge:
        yield source, trajectory
        return
    with session_folder([GivenSession(source, trajectory), *map(GivenSession.parse, merge)]) as folder:
        yield folder, None


def _build_here(
    source: Path,
    map_id: str,
    given: dict[str, Any],
    trajectory: Path | None,
    options: BuildOptions,
    as_json: bool,
) -> None:
    from firstfix.builds.config import BuildConfig
    from firstfix.builds.shared_stages import collect_stages
    from firstfix.catalog.catalog import Catalog
    from firstfix.catalog.query_samples import QuerySamples
    from firstfix.store.store import Store
    from firstfix_builder.execution.build_trace import BuildTrace
    from firstfix_builder.execution.dask_executor import check_reachable
    from firstfix_builder.job.build_job import BuildJob
    from firstfix_builder.job.confirmed_queries import collect_confirmed
    from firstfix_builder.pipeline import CONFIRMED, build_version

    from ..read_confined import read_confined

    settings = BuildConfig.parse(given)
    if options.scheduler is not None:
        check_reachable(options.store)
    opened = Store.open(options.store)
    opened.probe()  # before the work, not after it
    with _progress() as show, BuildTrace("", map_id, None) as trace:

        def progress(stage: str, fraction: float) -> None:
            trace.tick(stage)
            show(stage, fraction)

        samples, kept = QuerySamples(opened), options.work / "confirmed"
        confirmed = collect_confirmed(samples, map_id, settings.self_test.confirmed, kept)
        job = BuildJob(source, trajectory, given, options.work, progress, lambda: False, confirmed=confirmed)
        try:
            read_confined(job, options)
            built = build_version(
                source,
                settings,
                options.work / "build",
                trajectory=trajectory,
                confirmed=confirmed,
                progress=progress,
                options=options,
            )
        finally:  # scans of robots, however the build ends
            for folder in (kept, options.work / "build" / CONFIRMED):
                shutil.rmtree(folder, ignore_errors=True)
        progress(PUBLISH, 0.0)
        catalog = Catalog(opened)
        held = catalog.reason_to_hold(map_id, built.manifest, settings.activate)
        version = catalog.publish(map_id, built.directory, built.manifest, activate=held is None)
        progress(PUBLISH, 1.0)
        trace.end("succeeded")
    if options.scheduler is not None:  # there is no service that does it
        collect_stages(opened, CLUSTER_STAGES_S)
    _print(map_id, version, built.manifest, held, [asdict(stage) for stage in trace.stages], as_json)


def _given(
    path: Path | None,
    sensor: str | None,
    axis: Axis | None,
    scale: float | None = None,
    min_localized: float | None = None,
) -> dict[str, Any]:
    """Returns the given config: the file, with the options of the command line put over it."""
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
        if min_localized is not None:
            values["activate"] = {**(values.get("activate") or {}), "min_localized": min_localized}
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


@contextmanager
def _progress() -> Iterator[Callable[[str, float], None]]:
    """Shows a progress bar for each stage, on standard error."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description:18}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
    )
    tasks: dict[str, TaskID] = {}
    with Progress(*columns, console=Console(stderr=True)) as bars:

        def progress(stage: str, fraction: float) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=1.0)
            bars.update(tasks[stage], completed=fraction)

        yield progress


def _print(
    map_id: str,
    version: str,
    manifest: Manifest,
    held: Finding | None,
    stages: list[dict[str, Any]],
    as_json: bool,
) -> None:
    from firstfix.catalog.version_findings import findings_of

    said = {
        "map_id": map_id,
        "version": version,
        "counts": dict(manifest.counts),
        "bytes": manifest.total_bytes,
        "self_test": dict(manifest.self_test),
        "activated": held is None,
        "findings": [one.to_mapping() for one in [*findings_of(manifest), held] if one is not None],
        "stages": stages,
    }
    typer.echo(json.dumps(said) if as_json else "\n".join(_lines(said)))


def _lines(said: dict[str, Any]) -> list[str]:
    """Returns the content of ``--json`` as text."""
    if "version" not in said:
        return [f"build {said['build_id']} of {said['map_id']} is {said['state']}"]
    counts = ", ".join(f"{count:,} {name.replace('_', ' ')}" for name, count in said["counts"].items())
    size = f", {said['bytes'] / 1e6:,.0f} MB" if "bytes" in said else ""  # a service does not report it
    state = "" if said["activated"] else ", NOT ACTIVATED"
    return [
        f"published {said['map_id']}, version {said['version']}{state}",
        f"  {counts}{size}",
        *(f"  {line}" for line in self_test_lines(said["self_test"])),
        *(f"  {line}" for line in reused_lines(said["stages"])),
        *(f"  {line}" for line in finding_lines(map(Finding.from_mapping, said["findings"]))),
    ]
