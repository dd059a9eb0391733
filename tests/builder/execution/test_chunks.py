"""A stage in chunks: keyed by what they read, made once, whole or not at all."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest

from firstfix.builds.shared_stages import SharedStages, collect_stages
from firstfix.engine.config import OccupancyConfig, PcaScConfig
from firstfix.errors import BuildCancelled, StoreError
from firstfix.sensor import preset
from firstfix.store.store import Store
from firstfix_builder.execution import chunks as chunks_module
from firstfix_builder.execution.build_trace import BuildTrace
from firstfix_builder.execution.chunks import (
    ChunkBatch,
    ChunkCache,
    ChunkExecutor,
    ChunkResults,
    KeyedChunk,
    make_chunk,
    run_chunks,
)
from firstfix_builder.execution.stage_cache import StageCache, StageResult
from firstfix_builder.mesh.map_tiles import by_nested_tiles
from firstfix_builder.templates.make import TemplatesChunk, chunk_tile_m, template_chunks, write_templates
from tests.builder.execution.toy_chunks import Toy, keyed, runs


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store.open(str(tmp_path / "store"))


class Here(ChunkExecutor):
    """Runs chunks in this thread.

    Attributes:
        forgets: its results vanish before they are read.
    """

    def __init__(self, store: Store, *, forgets: bool = False) -> None:
        self.store = store
        self.forgets = forgets

    def run(self, batch: ChunkBatch) -> None:
        folders = {name: one.directory for name, one in batch.inputs.items()}
        for chunk in batch.chunks:
            if batch.cancelled():
                raise BuildCancelled("cancelled")
            make_chunk(self.store, chunk, folders)
            batch.done()
            if self.forgets:
                ChunkResults(self.store).remove(chunk.key)


def chunk_of(rows: tuple[int, int] = (0, 128)) -> TemplatesChunk:
    return TemplatesChunk(*rows, (0, 0), 16.0, 128.0, preset("vlp-16"), OccupancyConfig())


def run_all(
    store: Store, chunks: list[KeyedChunk], numbers: StageResult, told: list[float] | None = None
) -> list[list[int]]:
    """Runs those of the chunks that the store has no result of."""
    inputs = {"numbers": numbers}
    made = ChunkResults(store).made()
    progress = (lambda fraction: None) if told is None else told.append
    return [
        one["sum"].tolist() for one in run_chunks(Here(store), chunks, made, inputs, progress, lambda: False)
    ]


def test_the_values_say_what_decides_the_result_and_not_where_it_stands():
    chunk = chunk_of()
    elsewhere = replace(chunk, first=5, last=9, tile=(3, 4), tile_m=8.0)
    assert elsewhere.plain_values == chunk.plain_values == chunk_of().plain_values
    others = [
        replace(chunk, sensor=preset("xt32")),
        replace(chunk, descriptor=OccupancyConfig(rings=21)),
        replace(chunk, descriptor=PcaScConfig()),
    ]
    assert all(other.plain_values != chunk.plain_values for other in others)


def test_a_key_is_the_same_in_another_process(tmp_path: Path):
    code = (
        "import sys\n"
        "from pathlib import Path\n"
        "from firstfix_builder.templates.make import TemplatesChunk\n"
        "from firstfix_builder.execution.stage_cache import StageCache\n"
        "from firstfix.engine.config import OccupancyConfig\n"
        "from firstfix.sensor import preset\n"
        "chunk = TemplatesChunk(0, 128, (0, 0), 16.0, 128.0, preset('vlp-16'), OccupancyConfig())\n"
        "print(StageCache(Path(sys.argv[1])).key_of('s', {}, chunk.plain_values))"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "there")]
    said = subprocess.run(command, capture_output=True, text=True, check=True)
    assert said.stdout.strip() == StageCache(tmp_path / "here").key_of("s", {}, chunk_of().plain_values)


def test_viewpoints_are_shared_out_by_place_alone():
    rng = np.random.default_rng(0)
    positions = rng.uniform([-60, -200, 0], [150, 200, 1], (9000, 3))
    tile_m, side_m = 128.0, chunk_tile_m(128.0, 1.0)
    assert side_m == 16.0
    assert tile_m / chunk_tile_m(tile_m, 1.5) == 6

    def shared_out(positions: np.ndarray) -> dict[tuple[int, int], bytes]:
        order, start = by_nested_tiles(positions, tile_m, side_m)
        assert sorted(order) == list(range(len(positions)))
        chunks = template_chunks(positions[order], start, tile_m, 1.0, preset("vlp-16"), OccupancyConfig())
        assert [chunk.first for chunk in chunks] == [0, *(chunk.last for chunk in chunks[:-1])]
        assert chunks[-1].last == len(positions)
        for chunk in chunks:
            inside = positions[order[chunk.first : chunk.last], :2]
            assert (np.floor(inside / side_m) == chunk.tile).all()
        large = np.floor(positions[order, :2] / tile_m)
        assert len(np.unique(large, axis=0)) == 1 + np.any(np.diff(large, axis=0) != 0, axis=1).sum()
        return {chunk.tile: positions[order[chunk.first : chunk.last]].tobytes() for chunk in chunks}

    before = shared_out(positions)
    after = shared_out(np.concatenate([positions, [[-300.0, 5.0, 0.0], [3.0, 3.0, 0.0]]]))
    assert {tile for tile in after if after[tile] != before.get(tile)} == {(-19, 0), (0, 0)}


def test_parts_become_the_files_of_the_whole(tmp_path: Path):
    whole = {"position_m": np.random.default_rng(0).random((10, 3), np.float32), "a": np.arange(10)}
    parts = [{name: array[rows] for name, array in whole.items()} for rows in (slice(0, 4), slice(4, 10))]
    write_templates(iter(parts), 10, tmp_path)
    for name, array in whole.items():
        np.save(tmp_path / "expected.npy", array)
        assert (tmp_path / f"template_{name}.npy").read_bytes() == (tmp_path / "expected.npy").read_bytes()


def test_chunks_that_the_store_has_are_not_made_again(store: Store, log: Path, numbers: StageResult):
    chunks = [keyed(Toy(number, str(log))) for number in range(4)]
    told: list[float] = []
    make_chunk(store, chunks[1], {"numbers": numbers.directory})
    assert run_all(store, chunks, numbers, told) == [[n, n + 1, n + 2] for n in range(4)]
    assert [runs(log, number) for number in range(4)] == [1, 1, 1, 1]
    assert told == [0.5, 0.75, 1.0]
    assert run_all(store, chunks, numbers) == [[n, n + 1, n + 2] for n in range(4)]
    assert runs(log) == 4


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04", "flip", "cut", "remove", "record"])
def test_a_damaged_result_is_made_again(damage, store: Store, log: Path, numbers: StageResult):
    chunk = keyed(Toy(7, str(log)))
    make_chunk(store, chunk, {"numbers": numbers.directory})
    key, record = store.list("stages")
    whole = store.get(key)
    if damage == "remove":
        store.delete(key)
    elif damage == "record":
        store.put(record, b"{}")
    elif damage == "flip":
        at = whole.index(np.arange(7, 10).tobytes())
        store.put(key, whole[:at] + b"\xff" + whole[at + 1 :])
    else:
        store.put(key, whole[: len(whole) // 2] if damage == "cut" else damage)
    assert run_all(store, [chunk], numbers) == [[7, 8, 9]]
    assert runs(log) == 2
    assert store.get(key) == whole, "the same bytes"
    assert run_all(store, [chunk], numbers) == [[7, 8, 9]]
    assert runs(log) == 2


def test_a_store_that_forgets_is_given_up(store: Store, log: Path, numbers: StageResult):
    chunks = [keyed(Toy(1, str(log)))]
    forgets = Here(store, forgets=True)
    with pytest.raises(StoreError, match="does not keep"):
        list(run_chunks(forgets, chunks, set(), {"numbers": numbers}, lambda fraction: None, lambda: False))
    assert runs(log) == 4


@dataclass(frozen=True)
class Tile(Toy):
    """Reads one number of the stage ``numbers``, the one of its number, and says so."""

    def run(self, inputs: Mapping[str, Path]) -> dict[str, np.ndarray]:
        (Path(self.log) / f"{self.number}-{len(list(Path(self.log).iterdir()))}").touch()
        return {"sum": np.load(inputs["numbers"] / "numbers.npy")[self.number : self.number + 1] * 10}

    def reads(self, inputs: Mapping[str, StageResult]) -> Mapping[str, str]:
        return {"tile": str(np.load(inputs["numbers"].directory / "numbers.npy")[self.number])}


class Bench:
    """Runs tiles as a build does."""

    def __init__(self, folder: Path, log: Path, shared: SharedStages | None = None) -> None:
        self.folder = folder
        self.store = Store.open(str(folder / "chunks"))
        self.log = log
        self.shared = shared

    def sums(self, numbers: Iterable[int], cancelled=lambda: False) -> tuple[list[int], tuple[int, int]]:
        """The results, and how many chunks there were and how many of them were there before."""
        stage = self.folder / "numbers"
        stage.mkdir(exist_ok=True)
        np.save(stage / "numbers.npy", np.array(numbers))
        cache = ChunkCache(StageCache(self.folder, code_version="1"), Here(self.store), self.shared)
        chunks = [Tile(number, str(self.log)) for number in range(len(numbers))]
        inputs = {"numbers": StageResult("6" * 64, stage, "7" * 64)}
        with BuildTrace("b", "m", None) as trace:
            trace.tick("stage")
            found = list(cache.run("stage", chunks, inputs, lambda fraction: None, cancelled))
            trace.tick("next")
        return [int(one["sum"][0]) for one in found], (trace.stages[0].chunks, trace.stages[0].chunks_reused)


def test_only_the_chunks_whose_inputs_changed_are_made_again(tmp_path: Path, log: Path):
    bench = Bench(tmp_path, log)
    assert bench.sums([1, 2, 3, 4]) == ([10, 20, 30, 40], (4, 0))
    assert bench.sums([1, 2, 7, 4]) == ([10, 20, 70, 40], (4, 3))
    assert [runs(log, n) for n in range(4)] == [1, 1, 2, 1]
    assert bench.sums([1, 2, 3, 4, 5]) == ([10, 20, 30, 40, 50], (5, 4)), "the old map is there as well"
    assert runs(log) == 6


def test_another_machine_takes_what_is_shared(tmp_path: Path, log: Path):
    shared = SharedStages(Store.open(str(tmp_path / "maps")))
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    assert Bench(tmp_path / "one", log, shared).sums([1, 2, 3])[1] == (3, 0)
    assert Bench(tmp_path / "two", log, shared).sums([1, 9, 3]) == ([10, 90, 30], (3, 2))
    assert runs(log) == 4
    store = Store.open(str(tmp_path / "maps"))
    assert len(store.folders("stages")) == 4
    for key in store.list("stages"):
        store.put(key, b"damaged")
    (tmp_path / "three").mkdir()
    assert Bench(tmp_path / "three", log, shared).sums([1, 2, 3]) == ([10, 20, 30], (3, 0))


def test_a_cancelled_build_keeps_what_it_made(tmp_path: Path, log: Path):
    bench = Bench(tmp_path, log)
    with pytest.raises(BuildCancelled):
        bench.sums([1, 2, 3, 4], cancelled=lambda: runs(log) >= 2)
    assert bench.sums([1, 2, 3, 4]) == ([10, 20, 30, 40], (4, 2))
    assert [runs(log, n) for n in range(4)] == [1, 1, 1, 1]


def test_results_go_by_age_and_size(tmp_path: Path, log: Path):
    bench = Bench(tmp_path, log)
    bench.sums([1, 2, 3])
    assert bench.sums([9, 2, 3])[1] == (3, 2)
    size = sum(one.size_bytes for one in bench.store.scan("stages"))
    assert collect_stages(bench.store, 3600, max_bytes=size).removed == ()
    assert len(collect_stages(bench.store, 3600, max_bytes=size - 1).removed) == 1
    assert bench.sums([9, 2, 3])[1] == (3, 3), "what was made last is there"
    assert bench.sums([1, 2, 3])[1] == (3, 2)
    assert collect_stages(bench.store, -1).kept == 0
    assert bench.store.list("stages") == []
    assert bench.sums([1, 2, 3])[1] == (3, 0)


def test_a_result_that_is_used_after_its_first_day_is_young_again(
    tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch
):
    bench = Bench(tmp_path, log)
    bench.sums([1, 2, 3])
    monkeypatch.setattr(chunks_module, "RENEWED_AFTER", timedelta(0))
    assert bench.sums([1, 2, 9])[1] == (3, 2)
    size = sum(one.size_bytes for one in bench.store.scan("stages"))
    assert len(collect_stages(bench.store, 3600, max_bytes=size - 1).removed) == 1
    assert bench.sums([1, 2, 9])[1] == (3, 3), "the one that was used once has gone"


def test_arrays_made_of_others_are_made_once_for_the_same_content(store: Store, tmp_path: Path):
    cache = ChunkCache(StageCache(tmp_path / "cache", code_version="1"), Here(store))
    made: list[int] = []

    def double(values: np.ndarray) -> np.ndarray:
        def make() -> dict[str, np.ndarray]:
            made.append(len(values))
            return {"twice": 2 * values}

        return cache.made_of("build_index", "double", [values], make)["twice"]

    values = np.arange(4, dtype=np.float32)
    assert double(values).tolist() == double(values.copy()).tolist() == [0, 2, 4, 6]
    assert made == [4]
    for other in (values[:3], values.reshape(2, 2), values.astype(np.float64), values + 1):
        assert np.array_equal(double(other), 2 * other)
    assert len(made) == 5

    for key in ChunkResults(store).made():  # damaged by somebody
        for path in store.list(f"stages/{key}"):
            if not path.endswith(".json"):
                store.delete(path)
    assert double(values).tolist() == [0, 2, 4, 6]
    assert len(made) == 6
