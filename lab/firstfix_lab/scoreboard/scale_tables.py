"""Tables of the scale suite: a column for each world."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ..common.markdown import table
from .result import Result

World = Mapping[str, Any]


def summary(result: Result) -> list[str]:
    """A row for each world, in short."""
    head = ("world", "templates", "ms a query, median / 99 %", "best place within 0.2 m, share")
    head += ("false accepts", "version, MB")
    rows = [
        (
            name,
            world["templates"],
            _times(world["anywhere"]),
            world["anywhere"]["success"].get("0.2m"),
            world["anywhere"]["false"],
            world["version_mb"],
            world["build_cpu_s"],
        )
        for name, world in _worlds(result).items()
    ]
    return table((*head, "build, processor s"), rows)


def whole(result: Result) -> list[str]:
    """A row for each figure of queries and builds, and one for each engine of the key search."""
    worlds = _worlds(result)
    rows = [(name, *(shown(world) for world in worlds.values())) for name, shown in ROWS.items()]
    engines = dict.fromkeys(engine for world in worlds.values() for engine in world["keys"])
    keys = [
        (engine, *(_key_search(world["keys"].get(engine)) for world in worlds.values())) for engine in engines
    ]
    return [
        *table(("", *worlds), rows),
        "",
        "Key search alone, ms, and the share of scans with a template within 0.75 m among the 400 nearest:",
        "",
        *table(("engine", *worlds), keys),
    ]


def _worlds(result: Result) -> dict[str, World]:
    return dict(result.figures["worlds"])


def _times(asked: World) -> str:
    return f"{asked['median_ms']} / {asked['p99_ms']}"


def _stages(asked: World) -> str:
    ms = asked["stages_ms"]
    return " / ".join(f"{ms[stage]:.1f}" for stage in ("preprocess", "search", "register"))


def _cpu(*stages: str) -> Callable[[World], str]:
    return lambda world: f"{sum(world['build'][stage]['cpu_seconds'] for stage in stages):.0f}"


def _peak(world: World) -> str:
    stage, cost = max(world["build"].items(), key=lambda item: item[1]["peak_own_mb"])
    return f"{cost['peak_own_mb'] / 1e3:.1f} ({stage})"


def _key_search(found: Mapping[str, Any] | None) -> str | None:
    if found is None:
        return None
    ms = found.get("search_ms")
    return f"{found['true_among_400']:.3f}" if ms is None else f"{ms:.2f}, {found['true_among_400']:.3f}"


ROWS: dict[str, Callable[[World], Any]] = {
    "templates": lambda world: world["templates"],
    "extent, m": lambda world: " x ".join(map(str, world["extent_m"])),
    "version, MB": lambda world: world["version_mb"],
    "load, its files dropped from memory before, ms": lambda world: world["load_ms"],
    "first query after that, ms": lambda world: world["first_query_ms"],
    "query, p50 / p99, ms": lambda world: _times(world["anywhere"]),
    "... of it preprocessing / search / registration": lambda world: _stages(world["anywhere"]),
    "with a prior of 30 m around a place 10 m off, p50 / p99, ms": lambda world: _times(world["with_prior"]),
    "own memory of the process, MB: loaded / after all queries": lambda world: (
        f"{world['loaded']['own']} / {world['after_queries']['own']}"
    ),
    "resident then, pages of the files included, MB": lambda world: world["after_queries"]["resident"],
    "within 0.05 m / `localized`": lambda world: (
        f"{world['anywhere']['success'].get('0.05m')} / {world['anywhere']['localized']}"
    ),
    "false": lambda world: world["anywhere"]["false"],
    "build, s / processor s": lambda world: f"{world['build_s']} / {world['build_cpu_s']}",
    "... templates, processor s": _cpu("make_templates"),
    "... surface, keys, free space, index, processor s": _cpu(
        "reconstruct_mesh", "learn_keys", "carve_free_space", "build_index"
    ),
    "... self-test, processor s": _cpu("self_test"),
    "most memory of its own of a process of the build, GB": _peak,
}
