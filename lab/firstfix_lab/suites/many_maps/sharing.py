"""Queries by Zipf's law to four replicas whose caches are too small for all maps.

Counts how many queries find their version loaded, for each way to choose the replica. The service's own cache
and placement run in this process, so the counts are exact.
"""

from __future__ import annotations

import random
import shutil
import time
from collections import Counter
from collections.abc import Callable
from itertools import accumulate
from pathlib import Path
from typing import Any

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.rendezvous import rendezvous_order
from firstfix.store.store import Store
from firstfix_service.maps.map_cache import MapCache
from firstfix_service.maps.placement import Placement
from firstfix_service.query_workers.base import QueryWorkerThreads
from firstfix_service.telemetry.metrics import Metrics

from .catalogs import grow_catalog, name_of

REPLICAS = ["r1", "r2", "r3", "r4"]
GIB = 1 << 30
EXPONENT = 1.0
Choose = Callable[[str], str]  # of a map: the replica that is asked


class Group:
    """Replicas that hold maps together.

    Args:
        copies: 0: they share nothing.
        held: versions that each has memory for.
    """

    def __init__(self, catalog: Catalog, directory: Path, copies: int, held: int) -> None:
        self.metrics = {name: Metrics() for name in REPLICAS}
        self.caches = {}
        for name in REPLICAS:
            placement = Placement(name, copies) if copies else None
            if placement is not None:
                placement.set_replicas(REPLICAS)
            self.caches[name] = MapCache(
                catalog,
                directory / "cache",
                QueryWorkerThreads(lambda folder: _Nothing()),
                self.metrics[name],
                max_versions=held,
                max_bytes=GIB,
                max_disk_bytes=GIB,
                placement=placement,
            )
        for cache in self.caches.values():
            cache.poll()

    def count(self, metric: str, **labels: str) -> int:
        values = (one.registry.get_sample_value(metric, labels) for one in self.metrics.values())
        return int(sum(value or 0 for value in values))

    def offering(self, map_id: str) -> list[str]:
        return [name for name, cache in self.caches.items() if cache.is_offered(map_id)]

    def close(self) -> None:
        for cache in self.caches.values():
            cache.close()


class _Nothing:
    def localize(self, *_: object) -> Any:
        raise AssertionError("maps are only chosen here, nobody is answered")


def shares(
    directory: Path, maps: int, queries: int, cache_shares: tuple[float, ...], seed: int
) -> list[dict[str, Any]]:
    """For each size of the caches (share of all maps that one replica has memory for) and way of choosing."""
    root = directory / "tiny"
    grow_catalog(root, None, 0, maps)
    catalog = Catalog(Store.open(str(root)))
    asked = zipf(maps, queries, EXPONENT, seed)
    found = []
    for share in cache_shares:
        held = max(1, round(maps * share))
        for name, copies in (("any replica", 0), ("one by a hash", 0), ("holders", 1), ("holders", 2)):
            group = Group(catalog, directory, copies, held)
            figures = _ask(group, asked, _choices(name, group, seed))
            found.append({"maps": maps, "cache": share, "asked": name, "copies": copies, **figures})
            print(found[-1], flush=True)
            group.close()
    shutil.rmtree(root)
    return found


def zipf(maps: int, queries: int, exponent: float, seed: int) -> list[str]:
    """Map as they are asked for: the one of rank r with a weight of r ** -exponent."""
    order = random.Random(seed)
    names = [name_of(number) for number in range(maps)]
    order.shuffle(names)
    weights = list(accumulate((rank + 1) ** -exponent for rank in range(maps)))
    return order.choices(names, cum_weights=weights, k=queries)


def _choices(name: str, group: Group, seed: int) -> Choose:
    """The way in which a proxy with a hash, or a robot over zenoh, chooses a replica."""
    turn = random.Random(seed)
    if name == "one by a hash":
        return lambda map_id: rendezvous_order(map_id, REPLICAS)[0]
    return lambda map_id: turn.choice(group.offering(map_id))


def _ask(group: Group, asked: list[str], choose: Choose) -> dict[str, Any]:
    ahead = group.count("firstfix_version_loads_total", result="ok")
    load: Counter[str] = Counter()
    for map_id in asked:
        name = choose(map_id)
        load[name] += 1
        group.caches[name].served.lease([map_id]).result(60).close()
    hits = group.count("firstfix_cache_lookups_total", result="hit")
    return {
        "loaded_ahead": ahead,
        "met_loaded": round(hits / len(asked), 4),
        "loads": group.count("firstfix_version_loads_total", result="ok") - ahead,
        "busiest": round(max(load.values()) / len(asked), 3),
    }


def movement(maps: int, replicas: int, copies: int) -> dict[str, Any]:
    """Count the maps that move when one replica leaves."""
    names = [f"r{number}" for number in range(1, replicas + 1)]
    come, seconds, others = 0, 0.0, 0
    for name in names[:-1]:
        placement = Placement(name, copies)
        placement.set_replicas(names)
        placement.add_maps(map(name_of, range(maps)))
        before = set(placement.maps)
        begin = time.perf_counter()
        change = placement.set_replicas(names[:-1])
        seconds = max(seconds, time.perf_counter() - begin)
        come += len(change.gained)
        others += len(before - set(placement.maps))
    return {
        "maps": maps,
        "replicas": replicas,
        "copies": copies,
        "taken_over": round(come / (maps * copies), 4),
        "lost_by_others": others,
        "see_ms": round(1e3 * seconds, 1),
    }


def takeover(directory: Path, maps: int, copies: int) -> dict[str, Any]:
    """Count the versions that the other replicas load when the last one leaves, and the time of the slowest.

    They load one after the other. The versions have a few bytes: the time is what a load costs beside its
    files.
    """
    root = directory / "taken-over"
    grow_catalog(root, None, 0, maps)
    group = Group(Catalog(Store.open(str(root))), directory, copies, maps)
    *others, gone = REPLICAS
    held = group.caches[gone].held_loaded
    before = group.count("firstfix_version_loads_total", result="ok")
    seconds = []
    for name in others:
        begin = time.perf_counter()
        group.caches[name].set_replicas(others)
        seconds.append(time.perf_counter() - begin)
    figures = {
        "maps": maps,
        "replicas": len(REPLICAS),
        "copies": copies,
        "maps_held_by_one": held,
        "loads": group.count("firstfix_version_loads_total", result="ok") - before,
        "loaded_after": sum(group.caches[name].held_loaded for name in others),
        "slowest_s": round(max(seconds), 2),
    }
    group.close()
    shutil.rmtree(root)
    return figures
