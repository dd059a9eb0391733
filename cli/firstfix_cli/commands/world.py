"""``firstfix world``: a place to try it in."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def world(
    name: Annotated[str, typer.Argument(help="factory, office or campus.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Directory to write, made if missing.")],
    seed: Annotated[int, typer.Option(help="Another seed, another place of the same kind.", min=0)] = 0,
) -> None:
    """Make a sample world: true mesh, the cloud a SLAM would leave, trajectory, query scans, poses.csv."""
    from firstfix_builder.worlds import make_world, write_world

    made = make_world(name, seed=seed)
    write_world(made, out)
    typer.echo(
        f"{out}: {len(made.cloud):,} map points, {len(made.trajectory):,} poses of the mapping drive, "
        f"{len(made.queries)} query scans of a {made.sensor.name}"
    )
