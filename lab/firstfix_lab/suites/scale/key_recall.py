"""Key search alone: each engine's time, size and finds, against all distances."""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.engine.config import SearchConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.preprocess import preprocess
from firstfix.engine.retrieval.key_search import KeySearch
from firstfix.scan.sequence import ScanSequence
from firstfix_builder.execution.stage_cache import StageCache
from firstfix_builder.index.index_files import make_keys

from ...common.other_key_searches import OtherSearch, build_search, load_search
from .build import Built
from .queries import in_level_frame, read_scans

ENGINES = ("faiss_ivf_sq8", "faiss_sq8", "faiss_ivf_pq")
NEAREST = 400
RIGHT_M = 0.75
ROWS = 100_000


@dataclass(frozen=True)
class Asked:
    """Keys of templates and scans, and the right answers.

    Attributes:
        keys: (n, d) of the templates.
        position_m: (n, 3) of the templates.
        asked: (q, d) of the scans.
        right: of each scan, the templates of its place.
        exact: (q, NEAREST) the nearest of all, by whole keys.
    """

    keys: NDArray[np.float32]
    position_m: NDArray[np.float32]
    asked: NDArray[np.float32]
    right: Sequence[list[int]]
    exact: NDArray[np.int64]


def asked_of(built: Built, scans: Path, work: Path) -> Asked:
    index = MapIndex.load(built.version)
    cascade = index.cascade

    def produce(out: Path) -> None:
        every = np.arange(len(cascade.templates))
        np.save(
            out / "keys.npy", make_keys(cascade.templates, every, cascade.descriptor, cascade.projection, out)
        )

    inputs = {"templates": built.templates.digest, "learned": built.learned.digest}
    keys = np.load(StageCache(work).run("scale_keys", inputs, {}, produce).directory / "keys.npy", "r")
    taken, T_map_sensor = read_scans(scans)
    made, at = [], []
    for scan, T in zip(taken, in_level_frame(index.T_map_level, T_map_sensor), strict=True):
        prepared = preprocess(ScanSequence.single(scan), None, index.config.preprocess)
        if prepared is not None:
            made.append(cascade.key_of(prepared.scans[0].described_by(cascade.descriptor)))
            at.append(T[:3, 3])
    position_m = cascade.templates.position_m
    right = cKDTree(position_m).query_ball_point(np.array(at), max(RIGHT_M, built.spacing_m))
    asked = np.array(made)
    return Asked(keys, position_m, asked, right, _exact(keys, asked))


def key_recall(asked: Asked, engine: str) -> dict[str, Any]:
    """Build seconds, size, the median of a search on one thread, and what is found."""
    began = time.perf_counter()
    built = build_search(engine, asked.keys, SearchConfig(), asked.position_m)
    seconds = time.perf_counter() - began
    with TemporaryDirectory() as folder:
        built.save(Path(folder))
        files = list(Path(folder).iterdir())
        size = sum(path.stat().st_size for path in files)
        found, ms = _search(load_search(engine, Path(folder)), asked.asked)
    return {
        "build_s": round(seconds, 1),
        "bytes_a_key": round(size / len(asked.keys), 1),
        "files": len(files),
        "search_ms": ms,
        **_finds(found, asked),
    }


def exact_recall(asked: Asked) -> dict[str, Any]:
    """Recall with whole keys, without an index."""
    return _finds(list(asked.exact), asked)


def _search(
    engine: KeySearch | OtherSearch, asked: NDArray[np.float32]
) -> tuple[list[NDArray[np.int64]], float]:
    found, milliseconds = [], []
    for key in np.concatenate([asked, asked]):  # the first time its pages are read
        began = time.perf_counter()
        found.append(engine.search(key, NEAREST))
        milliseconds.append(1e3 * (time.perf_counter() - began))
    return found[len(asked) :], round(statistics.median(milliseconds[len(asked) :]), 2)


def _finds(found: Sequence[NDArray[np.int64]], asked: Asked) -> dict[str, Any]:
    hit = [len(np.intersect1d(rows, here)) > 0 for rows, here in zip(found, asked.right, strict=True)]
    same = [
        len(np.intersect1d(rows, exact)) / len(exact) for rows, exact in zip(found, asked.exact, strict=True)
    ]
    return {
        "true_among_400": round(float(np.mean(hit)), 4),
        "of_the_nearest_400": round(float(np.mean(same)), 4),
    }


def _exact(keys: NDArray[np.float32], asked: NDArray[np.float32]) -> NDArray[np.int64]:
    """(q, NEAREST) nearest first, of (n, d) keys in parts."""
    few = min(NEAREST, len(keys))
    nearest = np.empty((len(asked), 0), np.int64)
    away = np.empty((len(asked), 0))
    for start in range(0, len(keys), ROWS):
        part = np.asarray(keys[start : start + ROWS], np.float32)
        further = np.einsum("nd,nd->n", part, part) - 2 * asked @ part.T
        rows = np.broadcast_to(np.arange(start, start + len(part)), further.shape)
        nearest, away = np.concatenate([nearest, rows], axis=1), np.concatenate([away, further], axis=1)
        best = np.argsort(away, axis=1, kind="stable")[:, :few]
        nearest, away = np.take_along_axis(nearest, best, axis=1), np.take_along_axis(away, best, axis=1)
    return nearest
