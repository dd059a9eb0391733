"""``firstfix build``: a map becomes a published version."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..arguments import AsJson, cache_directory
from ..self_test_lines import self_test_lines

if TYPE_CHECKING:
    from firstfix.manifest import Manifest


class Axis(str, Enum):
    z_up = "z-up"
    y_up = "y-up"


class ExecutorName(str, Enum):
    threads = "threads"


def build(
    source: Annotated[Path, typer.Argument(metavar="MAP", help="Cloud, mesh or SLAM folder.")],
    map_id: Annotated[str, typer.Option(help="Id that the map gets: a-z, 0-9, _ and -.")],
    store: Annotated[str, typer.Option(help="Object store: a directory, s3://..., gs://..., az://...")],
    sensor: Annotated[
        str | None, typer.Option(help="LiDAR preset, or the path of a sensor YAML [default: os1-64].")
    ] = None,
    trajectory: Annotated[
        Path | None, typer.Option(help="Poses of the mapping run: TUM, KITTI rows or CSV.")
    ] = None,
    config: Annotated[Path | None, typer.Option(help="Build config, YAML or JSON.")] = None,
    axis: Annotated[Axis | None, typer.Option(help="Which axis of the file points up.")] = None,
    work: Annotated[
        Path | None, typer.Option(help="Where finished stages are kept, so that a build resumes.")
    ] = None,
    executor: Annotated[ExecutorName, typer.Option(help="Who does the work.")] = ExecutorName.threads,
    as_json: AsJson = False,
) -> None:
    """Build a map's index, test it, and publish it as the active version."""
    from firstfix.catalog import Catalog
    from firstfix.ids import check_map_id
    from firstfix.store import Store
    from firstfix_builder.pipeline import build_version

    check_map_id(map_id)
    settings = _config(config, sensor, axis)
    opened = Store.open(store)
    opened.probe()  # before the work, not after it
    with _progress() as progress:
        built = build_version(
            source,
            settings,
            (work or cache_directory("build")) / map_id,
            trajectory=trajectory,
            progress=progress,
        )
        progress("publish", 0.0)
        version = Catalog(opened).publish(map_id, built.directory, built.manifest)
        progress("publish", 1.0)
    _print(map_id, version, built.manifest, as_json)


def _config(path: Path | None, sensor: str | None, axis: Axis | None) -> Any:
    """The build's config: the file, with what the command line says put over it."""
    import yaml

    from firstfix.build_config import BuildConfig
    from firstfix.errors import InvalidOption, NotFound

    try:
        base = BuildConfig() if path is None else BuildConfig.from_file(path)
        values = base.to_mapping()
        if axis is not None:
            values["axis"] = axis.value
        if sensor is not None:
            is_file = sensor.endswith((".yaml", ".yml", ".json"))
            values["sensor"] = yaml.safe_load(Path(sensor).read_text()) if is_file else sensor
    except FileNotFoundError as error:
        raise NotFound(f"{error.filename}: no such file") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InvalidOption(f"{sensor}: {error}") from None
    return BuildConfig.parse(values)


@contextmanager
def _progress() -> Iterator[Callable[[str, float], None]]:
    """A bar a stage, on standard error."""
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


def _print(map_id: str, version: str, manifest: Manifest, as_json: bool) -> None:
    tested: dict[str, Any] = dict(manifest.self_test)
    if as_json:
        answer = {
            "map_id": map_id,
            "version": version,
            "counts": dict(manifest.counts),
            "bytes": manifest.total_bytes,
            "self_test": tested,
        }
        typer.echo(json.dumps(answer))
        return
    typer.echo(f"published {map_id}, version {version}")
    counts = ", ".join(f"{count:,} {name.replace('_', ' ')}" for name, count in manifest.counts.items())
    typer.echo(f"  {counts}, {manifest.total_bytes / 1e6:,.0f} MB")
    for line in self_test_lines(tested):
        typer.echo(f"  {line}")
