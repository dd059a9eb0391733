"""``firstfix sensor``: measure an unknown sensor from its scans, and write its YAML."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..arguments import AsJson, Columns, columns_of, examples

if TYPE_CHECKING:
    from firstfix.sensor.measure import MeasuredSensor

EXAMPLES = examples(
    "firstfix sensor scan.pcd",
    "firstfix sensor scan_1.pcd scan_2.pcd scan_3.pcd --name front -o front.yaml",
    "firstfix build hall.ply --map-id hall --store store --sensor front.yaml",
)
WAYS = {
    "field": "by the field of the format",
    "order": "by the order of the points",
    "elevation": "by the elevations of the points",
}


def sensor(
    scans: Annotated[
        list[Path],
        typer.Argument(
            metavar="SCAN...", help="Scans of one sensor, each as it came: .pcd, .ply, .bin, .npy, .laz ..."
        ),
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File to write [default: standard output].")
    ] = None,
    name: Annotated[str, typer.Option(help="Name of the sensor.")] = "measured",
    columns: Columns = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there.")] = False,
    as_json: AsJson = False,
) -> None:
    """Measure an unknown sensor from its scans.

    It finds the beams and their elevations, the columns, the field of view, the range, the noise and the
    height above the floor, writes them as a sensor YAML for build --sensor, and names the preset that looks
    like it. Scans must be in the sensor's own frame, not moved, merged or thinned. Several tell more.
    """
    from firstfix.errors import InvalidOption
    from firstfix.sensor.measure import measure_sensor

    from ..limited_reader import read_cloud
    from ..scan_report import report_of_cloud
    from ..sensor_scan import sensor_scan

    if output is not None and output.exists() and not force:
        raise InvalidOption(f"{output} is there: --force replaces it")
    clouds = [(str(path), read_cloud(path, columns_of(columns))) for path in scans]
    found = measure_sensor([sensor_scan(*one) for one in clouds], name)
    understood = report_of_cloud(clouds[0][1]).understood
    notes = [*notes_of(found), *(f"{subject}: {understood[subject]}" for subject in ("fields", "times"))]
    text = _yaml(found, notes)
    if output is not None:
        output.parent.mkdir(parents=True, exist_ok=True)
        output.write_text(text)
    if as_json:
        said = {
            "sensor": found.sensor.to_mapping(),
            "rings_by": found.way,
            "presets": list(found.presets),
            "scans": found.scans,
            "points": found.points,
            "notes": notes,
        }
        typer.echo(json.dumps(said))
    elif output is not None:
        typer.echo("\n".join([*notes, f"written to {output}"]))
    else:
        typer.echo(text, nl=False)


def notes_of(found: MeasuredSensor) -> list[str]:
    """One sentence for each property: how it was measured, or that it was not."""
    model = found.sensor
    low, high = min(model.elevations_deg), max(model.elevations_deg)
    field = f"{low:g} to {high:g} degrees up, {model.azimuth_fov_deg:g} degrees around"
    notes = [f"measured from {found.points:,} points in {found.scans} scan{'s' * (found.scans > 1)}"]
    if found.way is not None:
        notes.append(
            f"{len(model.elevations_deg)} rings, told {WAYS[found.way]}, {model.azimuth_step_deg:g} degrees "
            f"between columns; {field}"
        )
    elif found.thinned:
        notes.append(
            "no rings can be told: the points lie evenly in space, so the scan was thinned. The model has "
            f"its field of view and number of points alone: {field}"
        )
    else:
        notes.append(
            "no rings: a sensor of another pattern, or points that were moved or thinned. The model has as "
            f"many rays in the same field of view: {field}"
        )
    if found.presets:
        first, *others = found.presets
        also = f" (or {', '.join(others)}, which cannot be told from it)" if others else ""
        notes.append(f"looks like {first}{also}: use --sensor {first}")
    else:
        notes.append("looks like no preset")
    notes.append("max_range_m is that of the farthest return: the sensor may see farther")
    if not found.floor_seen:
        notes.append("mount_height_m is a guess: no scan shows the floor")
    if not found.noise_seen:
        notes.append("range_noise_m is the usual one: the scans do not tell it")
    return notes


def _yaml(found: MeasuredSensor, notes: list[str]) -> str:
    import yaml

    head = "".join(f"# {note}\n" for note in notes)
    return head + yaml.safe_dump(
        found.sensor.to_mapping(), sort_keys=False, default_flow_style=None, width=110
    )
