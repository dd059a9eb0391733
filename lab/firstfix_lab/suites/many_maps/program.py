"""``firstfix-lab many_maps``: figures of lab/docs/many-maps.md, as JSON."""

from __future__ import annotations

import argparse
import json
import logging
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import structlog

from ...common.programs import BUCKET, missing, s3_server
from ...common.small_map import make_small_map, query_of
from .any_map import any_map
from .catalogs import environment, grow_catalog
from .one_replica import memory_of_loaded, one_replica
from .sharing import movement, shares, takeover

PARTS = ("replica", "shares", "movement", "takeover", "any_map")
SIZES = (100, 1_000, 10_000)
LOADED = 400
SHARED_MAPS = 2_000
FLOORS = 200
CACHES = (0.1, 0.3, 0.6)  # of all maps, for each of four replicas


def main(argv: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(prog="firstfix-lab many_maps", description=__doc__)
    parser.add_argument("--part", action="append", choices=PARTS, help="only this; may be repeated")
    parser.add_argument(
        "--maps", type=int, action="append", metavar="N", help="sizes; default: 100, 1000, 10000"
    )
    parser.add_argument("--idle", type=float, default=20.0, metavar="S", help="seconds that nobody asks for")
    parser.add_argument("--queries", type=int, default=20_000, help="of the Zipf load")
    parser.add_argument(
        "--floors",
        type=int,
        default=FLOORS,
        metavar="N",
        help="of any_map, simulated; other maps are made up",
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--version", type=Path, metavar="DIR", help="version of every map; default: built here"
    )
    parser.add_argument("--work", type=Path, help="folder for all of it; default: a temporary one")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    chosen = parser.parse_args(argv)
    sizes = sorted(chosen.maps or SIZES)
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.WARNING))
    figures: dict[str, Any] = {"machine": {"cpus": os.cpu_count()}, "seed": chosen.seed}
    with tempfile.TemporaryDirectory(prefix="firstfix-bench-", dir=chosen.work) as folder:
        for part in chosen.part or PARTS:
            if part == "replica":
                figures[part] = _replicas(Path(folder), chosen.version, sizes, chosen.idle, chosen.seed)
            elif part == "shares":
                maps = min(sizes[-1], SHARED_MAPS)
                figures[part] = shares(Path(folder), maps, chosen.queries, CACHES, chosen.seed)
            elif part == "any_map":
                figures[part] = any_map(Path(folder), chosen.floors, sizes[-1], chosen.seed)
            elif part == "takeover":
                maps = min(sizes[-1], SHARED_MAPS)
                figures[part] = [takeover(Path(folder), maps, copies) for copies in (1, 2)]
            else:
                figures[part] = [
                    movement(maps, count, copies) for maps in sizes for count in (4, 16) for copies in (1, 2)
                ]
    text = json.dumps(figures, indent=1)
    print(text)
    if chosen.json:
        chosen.json.write_text(text + "\n")


def _replicas(
    directory: Path, version: Path | None, sizes: list[int], idle_s: float, seed: int
) -> list[dict[str, Any]]:
    """Over a directory, and over an S3 gateway whose objects stand in that directory."""
    if (reason := missing("versitygw")) is not None:
        return [{"skipped": reason}]
    version = version or make_small_map(directory / "small")
    body, found, have = query_of(version), [], 0
    with s3_server(directory) as (port, credentials), environment(credentials):
        root = directory / "objects" / BUCKET
        stores = {
            "directory": str(root),
            "s3": f"s3://{BUCKET}?endpoint=http://127.0.0.1:{port}&region=us-east-1&allow_http=true",
        }
        for maps in sizes:
            grow_catalog(root, version, have, maps)
            have = maps
            for name, url in stores.items():
                folder = directory / f"{name}-{maps}"
                found.append({"store": name, **one_replica(url, maps, body, folder, idle_s, seed)})
                print(found[-1], flush=True)
        found.append(memory_of_loaded(str(root), (16, min(LOADED, sizes[-1])), directory / "loaded"))
        print(found[-1], flush=True)
    return found
