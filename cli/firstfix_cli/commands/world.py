"""``firstfix world``: make a sample world."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from firstfix.doors import WORLDS, absent, through
from firstfix.errors import InvalidOption

from ..arguments import examples

EXAMPLES = examples(
    "firstfix world factory -o world",
    "firstfix world factory -o world --seed 3",
    "firstfix world city -o city --extent 400",
)


def world(
    name: Annotated[
        str, typer.Argument(help="Kind of world: factory; with the lab office, campus, farm or city, too.")
    ],
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
    from ..sample_world import make_world
    from ..sample_world.write_world import write_sample

    writers = {key: write for found in through(WORLDS).values() for key, write in found.items()}
    if name in writers:
        line = writers[name](out, seed, extent_m)
    elif lacking := next((package for package in absent() if name in package.worlds), None):
        raise InvalidOption(lacking.remedy(f"the world {name!r}"))
    elif extent_m is not None:
        raise InvalidOption(f"only a city has an extent, and not {name!r}")
    else:
        line = write_sample(make_world(name, seed=seed), out)
    typer.echo(f"{out}: {line}")
