"""``firstfix world``: make a sample world."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from firstfix.errors import InvalidOption

from ..arguments import examples

CITY_M = 400.0

EXAMPLES = examples(
    "firstfix world office -o world",
    "firstfix world factory -o world --seed 3",
    "firstfix world city -o city --extent 400",
)


def world(
    name: Annotated[str, typer.Argument(help="Kind of world: factory, office, campus, farm or city.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder to write; made if missing.")],
    seed: Annotated[int, typer.Option(help="Each seed gives another place of the same kind.", min=0)] = 0,
    extent_m: Annotated[
        float | None, typer.Option("--extent", help="Of a city along x and y, in metres [default: 400].")
    ] = None,
) -> None:
    """Make a sample world to try firstfix in.

    It consists of the true mesh, a point cloud as SLAM would build it, the trajectory of the mapping drive,
    query scans, and their true poses in poses.csv. A city has its true meshes alone, a folder of files.
    """
    from firstfix_worlds import make_world, write_city, write_world

    if name == "city":
        city = write_city(out, extent_m=CITY_M if extent_m is None else extent_m, seed=seed)
        typer.echo(f"{out}: meshes of {city.side**2:,} blocks in {out / 'mesh'}, with query scans")
        return
    if extent_m is not None:
        raise InvalidOption(f"only a city has an extent, and not {name!r}")
    made = make_world(name, seed=seed)
    write_world(made, out)
    typer.echo(
        f"{out}: {len(made.cloud):,} map points, {len(made.trajectory):,} poses of the mapping drive, "
        f"{len(made.queries)} query scans of a {made.sensor.name}"
    )
