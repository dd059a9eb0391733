"""``firstfix world``: make a sample world."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..arguments import examples

EXAMPLES = examples(
    "firstfix world office -o world",
    "firstfix world factory -o world --seed 3",
)


def world(
    name: Annotated[str, typer.Argument(help="Kind of world: factory, office, campus or farm.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder to write; made if missing.")],
    seed: Annotated[int, typer.Option(help="Each seed gives another place of the same kind.", min=0)] = 0,
) -> None:
    """Make a sample world to try firstfix in.

    It consists of the true mesh, a point cloud as SLAM would build it, the trajectory of the mapping drive,
    query scans, and their true poses in poses.csv.
    """
    from firstfix_builder.simulation.worlds import make_world, write_world

    made = make_world(name, seed=seed)
    write_world(made, out)
    typer.echo(
        f"{out}: {len(made.cloud):,} map points, {len(made.trajectory):,} poses of the mapping drive, "
        f"{len(made.queries)} query scans of a {made.sensor.name}"
    )
