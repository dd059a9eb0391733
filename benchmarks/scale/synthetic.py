"""Key search alone beyond what is simulated: keys of a measured world, copied and moved apart.

python -m benchmarks.scale.synthetic KEYS.npy POSITIONS.npy --copies 10 --engine faiss_ivf_sq8

KEYS is ``keys.npy`` of the stage ``scale_keys``, POSITIONS its ``template_position_m.npy``. Copies are
moved by half of the keys' own spread and stand side by side. Time, memory and size are as those of so many
keys; what would be found is not: nobody took a scan there.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.engine.config import SearchConfig
from firstfix.engine.retrieval.key_search import build_key_search, load_key_search

from .key_recall import ENGINES, NEAREST, Engine

MOVED = 0.5  # of the keys' standard deviation
QUERIES = 200
ROWS = 100_000


def synthetic(
    keys: NDArray[np.float32], position_m: NDArray[np.float32], copies: int, engine: Engine, work: Path
) -> dict[str, Any]:
    """Measures the recall of one engine on synthetic keys.

    Args:
        keys, position_m: (n, d) and (n, 3).
        work: for a file of all keys, and the index.
    """
    count, spread = len(keys), keys[:ROWS].std(axis=0) * MOVED
    width_m = np.ptp(position_m[:, 0]) + 1
    with TemporaryDirectory(dir=work) as folder:
        shape = (copies * count, keys.shape[1])
        every = np.lib.format.open_memmap(Path(folder) / "all.npy", "w+", np.float32, shape)
        for copy in range(copies):
            rng = np.random.default_rng(copy)
            for start in range(0, count, ROWS):
                part = keys[start : start + ROWS]
                noise = rng.standard_normal(part.shape, np.float32) * spread if copy else 0
                every[copy * count + start : copy * count + start + len(part)] = part + noise
        at = np.concatenate([position_m + np.float32([copy * width_m, 0, 0]) for copy in range(copies)])
        config = SearchConfig(engine=engine)
        began, cpu = time.perf_counter(), time.process_time()
        index = Path(folder) / "index"
        index.mkdir()
        build_key_search(every, config, at).save(index)
        built_s, built_cpu_s = time.perf_counter() - began, time.process_time() - cpu
        size = sum(path.stat().st_size for path in index.iterdir())
        asked = keys[rows_by_chance(count, QUERIES)] + spread
        search, ms = load_key_search(index, config), []
        for key in np.concatenate([asked, asked]).astype(np.float32):
            began = time.perf_counter()
            search.search(key, NEAREST)
            ms.append(1e3 * (time.perf_counter() - began))
        again = ms[len(asked) :]
        return {
            "engine": engine,
            "keys": len(every),
            "files": len(list(index.iterdir())),
            "build_s": round(built_s),
            "build_cpu_s": round(built_cpu_s),
            "bytes_a_key": round(size / len(every), 1),
            "search_median_ms": round(statistics.median(again), 2),
            "search_p99_ms": round(float(np.percentile(again, 99)), 2),
        }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="benchmarks.scale.synthetic", description=__doc__)
    parser.add_argument("keys", type=Path)
    parser.add_argument("positions", type=Path)
    parser.add_argument("--copies", type=int, default=10)
    parser.add_argument("--engine", action="append", choices=ENGINES)
    parser.add_argument("--work", type=Path, default=Path(gettempdir()))
    chosen = parser.parse_args()
    for name in chosen.engine or ENGINES:
        figures = synthetic(
            np.load(chosen.keys, "r"), np.load(chosen.positions), chosen.copies, name, chosen.work
        )
        json.dump(figures, sys.stdout)
        print(flush=True)
