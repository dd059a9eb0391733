"""Memory of a replica: all its processes together, shared pages counted once."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ...common.load import Body, ask_over_http
from ...common.memory import pss_of_family
from ...common.programs import replica
from .queried_version import QueriedVersion

MAP = "bench"
MIB = 1 << 20


def replica_memory(
    queried: QueriedVersion, bodies: list[Body], directory: Path, workers: Sequence[int]
) -> dict[str, Any]:
    """MiB by number of workers, when every body was asked for twice."""
    store = str(directory / "store")
    version = queried.publish(store, MAP, directory)
    mib = {}
    for number in workers:
        with (
            replica(directory / f"{number}", store=store, workers=number, run_builds=False) as one,
            contextmanager(ask_over_http)(one.url, MAP) as ask,
            ThreadPoolExecutor(number) as clients,
        ):
            assert set(clients.map(ask, bodies * 2)) == {"ok"}
            mib[number] = round(pss_of_family(one.pid) / MIB)
    return {"version_mb": round(_bytes_below(Path(store), version) / 1e6, 1), "mib_by_workers": mib}


def _bytes_below(store: Path, version: str) -> int:
    folder = store / "maps" / MAP / "versions" / version
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
