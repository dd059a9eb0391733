"""``firstfix dataset``: make a map's scans of a public data set's recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from firstfix_cli.arguments import examples

from ..datasets.names import Dataset

EXAMPLES = examples(
    "firstfix dataset nclt nclt/2012-01-15 -o map",
    "firstfix dataset recording drive.mcap -o map",
    "firstfix build map --map-id nclt --store store --sensor hdl-32e",
    "firstfix evaluate nclt/2012-02-04 --dataset nclt --map nclt --store store",
)
Lidar = Annotated[
    str | None,
    typer.Option(help="With helipr: Ouster, Velodyne, Avia or Aeva [default: the only one there]."),
]


def dataset(
    name: Annotated[
        Dataset, typer.Argument(metavar="DATASET", help="Name of the data set; recording: any of your own.")
    ],
    recording: Annotated[Path, typer.Argument(help="Folder of one recording, as the authors ship it.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder to write; it must not exist.")],
    lidar: Lidar = None,
    spacing_m: Annotated[
        float, typer.Option("--spacing", help="Metres: one scan by chance from each such square is used.")
    ] = 1.0,
    voxel_m: Annotated[
        float, typer.Option("--voxel", help="Metres: of each scan one point is kept in each such cube.")
    ] = 0.1,
    max_range_m: Annotated[
        float, typer.Option("--max-range", help="Metres: farther points are left out.")
    ] = 60.0,
    seed: Annotated[int, typer.Option(help="Seed of the choice.", min=0)] = 0,
) -> None:
    """Make a map's scans of a recording with poses.

    Writes scans and their true poses (mapping_scans/) to a folder that ``firstfix build`` makes a map of. It
    holds some of them out, and its self-test asks them. The map is in the frame of the data set's ground
    truth. Then ``firstfix evaluate --dataset`` asks scans of another recording of the same place.
    """
    from tempfile import TemporaryDirectory

    from rich.console import Console
    from rich.progress import track

    from firstfix.errors import InvalidOption

    from ..datasets.datasets import open_dataset
    from ..datasets.mapping_run import write_mapping_run
    from ..datasets.recording import one_a_place

    if out.exists():
        raise InvalidOption(f"{out} is there already: name a new folder")
    opened = open_dataset(name, recording, lidar)
    for note in opened.notes:
        typer.echo(note, err=True)
    chosen = one_a_place(opened.T_map_sensor, spacing_m, seed)
    scans = track(
        opened.read(chosen), "read", total=len(chosen), console=Console(stderr=True), transient=True
    )
    out.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=out.parent, prefix=f".{out.name}-") as made:
        written, points = write_mapping_run(Path(made) / out.name, scans, voxel_m, max_range_m)
        (Path(made) / out.name).rename(out)
    typer.echo(f"{out}: {points} points of {written} scans; then: firstfix build {out} --map-id ID")
