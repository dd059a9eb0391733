"""Choice of the maps of a query that names none: how often the right one is among them, time and memory.

The floors are simulated, one template set each, and their queries are held out. More maps than floors are
made by exchanging the layers' rings of a floor by those of another one: such maps are nobody's, and they are
only there to be passed over.
"""

from __future__ import annotations

import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from firstfix.answer.options import LocalizeOptions
from firstfix.engine.map_choice.coarse_index import MAX_TEMPLATES, CoarseIndex
from firstfix.engine.map_choice.coarse_templates import CoarseTemplates
from firstfix.engine.map_choice.sought_scan import describe_sought
from firstfix_service.query_workers.query import CHOSEN_MAPS

from ...common.memory import pss_of_family
from .catalogs import name_of
from .floors import Floor, make_floor

SIZES = (16, 50, 100, 200, 400)  # maps, of which all are floors
AT_ONCE = 256


@dataclass(frozen=True)
class _Asked:
    """A query's outcome.

    Attributes:
        place: of the right map in the order; None: it is not among the chosen.
    """

    place: int | None
    describe_ms: float
    choose_ms: float


def any_map(directory: Path, floors: int, maps: int, seed: int) -> list[dict[str, Any]]:
    """Figures by the number of maps.

    Args:
        floors: that are simulated, some seconds each.
        maps: with made-up ones, for time and memory.
    """
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as processes:
        made = list(processes.map(make_floor, range(seed, seed + floors)))
    figures = []
    for count in [*(size for size in SIZES if size < floors), floors]:
        index = CoarseIndex(directory)
        index.change({name_of(k): made[k].templates for k in range(count)})
        figures.append({"maps": count, "made_up": 0, **_figures(index, made[:count])})
        print(figures[-1], flush=True)
    if maps > floors:
        figures.append(_with_made_up(directory, made, maps, seed))
    return figures


def _with_made_up(directory: Path, made: list[Floor], maps: int, seed: int) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    before, began = pss_of_family(os.getpid()), time.perf_counter()
    index = CoarseIndex(directory)
    index.change({name_of(k): one.templates for k, one in enumerate(made)}, expected=maps)
    for first in range(len(made), maps, AT_ONCE):
        more = {name_of(k): _made_up(made, rng) for k in range(first, min(first + AT_ONCE, maps))}
        index.change(more, expected=maps)
    index_s = time.perf_counter() - began
    figures = {"maps": maps, "made_up": maps - len(made), **_figures(index, made)}
    grown = (pss_of_family(os.getpid()) - before) / 1e6
    return {**figures, "index_s": round(index_s), "grown_mb": round(grown), "most": MAX_TEMPLATES}


def _made_up(made: list[Floor], rng: np.random.Generator) -> CoarseTemplates:
    """Templates whose layers are those of two floors, one of them turned."""
    one, other = (made[k].templates for k in rng.integers(len(made), size=2))
    count = min(len(one), len(other))
    whole = one.described["occupancy"][:count].copy()
    row_bytes = whole.shape[1] // 5  # a layer
    rows = rng.permutation(count)
    whole[:, :row_bytes] = other.described["occupancy"][rows, :row_bytes]
    return CoarseTemplates(one.form, {"occupancy": whole})


def _figures(index: CoarseIndex, made: list[Floor]) -> dict[str, Any]:
    asked = [_ask(index, scan, name_of(k)) for k, floor in enumerate(made) for scan in floor.scans]
    right = [one.place for one in asked if one.place is not None]
    return {
        "queries": len(asked),
        "templates": index.templates,
        "first": round(sum(place == 0 for place in right) / len(asked), 3),
        f"among_{CHOSEN_MAPS}": round(len(right) / len(asked), 3),
        "describe_ms": round(median(one.describe_ms for one in asked), 1),
        "choose_ms": round(median(one.choose_ms for one in asked), 1),
    }


def _ask(index: CoarseIndex, scan: Any, right: str) -> _Asked:
    began = time.perf_counter()
    sought = describe_sought(scan, LocalizeOptions(), index.forms)
    described = time.perf_counter()
    found = index.best(sought, lambda map_id: True, CHOSEN_MAPS)
    chosen = time.perf_counter()
    place = found.index(right) if right in found else None
    return _Asked(place, 1e3 * (described - began), 1e3 * (chosen - described))
