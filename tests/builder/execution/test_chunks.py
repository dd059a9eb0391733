"""A stage in chunks: named by what they are, made once, whole or not at all."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from firstfix.builds.shared_stages import SharedStages, collect_stages
from firstfix.engine.config import OccupancyConfig, PcaScConfig
from firstfix.errors import StoreError
from firstfix.sensor import preset
from firstfix.store.store import Store
from firstfix_builder.execution.chunk_executor import ChunkBatch, ChunkExecutor, run_chunks
from firstfix_builder.execution.chunks import ChunkResults, make_chunk
from firstfix_builder.execution.stage_cache import StageResult
from firstfix_builder.mesh.map_tiles import by_tiles
from firstfix_builder.templates.make import TemplatesChunk, template_chunks, write_templates

sys.path.insert(0, str(Path(__file__).parent))
from toy_chunks import Toy, runs

STAGE = "5" * 64


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store.open(str(tmp_path / "store"))


@pytest.fixture
def log(tmp_path: Path) -> Path:
    (tmp_path / "log").mkdir()
    return tmp_path / "log"


@pytest.fixture
def numbers(tmp_path: Path) -> StageResult:
    (tmp_path / "numbers").mkdir()
    np.save(tmp_path / "numbers" / "numbers.npy", np.arange(3))
    return StageResult("6" * 64, tmp_path / "numbers", "7" * 64)


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
            make_chunk(self.store, batch.stage, chunk, folders)
            batch.done()
        if self.forgets:
            ChunkResults(self.store, batch.stage).remove()


def chunk_of(rows: tuple[int, int] = (0, 128)) -> TemplatesChunk:
    return TemplatesChunk(*rows, (0.0, 0.0), (9.0, 9.0), preset("vlp-16"), OccupancyConfig())


def test_a_name_says_all_that_makes_the_chunk():
    chunk = chunk_of()
    others = [
        chunk_of((0, 127)),
        replace(chunk, high=(9.0, 9.5)),
        replace(chunk, sensor=preset("xt32")),
        replace(chunk, descriptor=OccupancyConfig(rings=21)),
        replace(chunk, descriptor=PcaScConfig()),
        Toy(0, ""),
    ]
    assert chunk.name == chunk_of().name
    assert len({one.name for one in (chunk, *others)}) == 7


def test_a_name_is_the_same_in_another_process():
    code = (
        "from firstfix_builder.templates.make import TemplatesChunk\n"
        "from firstfix.engine.config import OccupancyConfig\n"
        "from firstfix.sensor import preset\n"
        "print(TemplatesChunk(0, 128, (0.0, 0.0), (9.0, 9.0), preset('vlp-16'), OccupancyConfig()).name)"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == chunk_of().name


def viewpoints_of(positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions as a build orders them, and the first of each tile of 128 m."""
    positions = positions[by_tiles(positions, 16.0)[0]]
    order, start = by_tiles(positions, 128.0)
    return positions[order], start


def test_viewpoints_are_shared_out_square_by_square():
    positions, start = viewpoints_of(np.random.default_rng(0).uniform(-150, 150, (9000, 3)))
    chunks = template_chunks(positions, start, 128.0, 16.0, preset("vlp-16"), OccupancyConfig())
    assert [chunk.first for chunk in chunks] == [0, *(chunk.last for chunk in chunks[:-1])]
    assert chunks[-1].last == 9000
    squares = [np.unique(np.floor(positions[c.first : c.last, :2] / 16), axis=0) for c in chunks]
    assert {len(square) for square in squares} == {1}
    assert len(chunks) == len(np.unique(np.concatenate(squares), axis=0)) == 20 * 20
    for first, last in pairwise(start):
        (box,) = {(c.low, c.high) for c in chunks if first <= c.first and c.last <= last}
        assert np.subtract(*box[::-1]).tolist() == [128.0, 128.0]
        assert (np.array(box) % 128 == 0).all()


def test_a_new_wing_leaves_the_chunks_elsewhere_alone():
    old = np.random.default_rng(1).uniform(0, 100, (3000, 3))
    wing = np.random.default_rng(2).uniform([-300, -50, 0], [-1, 90, 3], (800, 3))

    def work_of(positions: np.ndarray) -> set[tuple[bytes, object, object]]:
        ordered, start = viewpoints_of(positions)
        chunks = template_chunks(ordered, start, 128.0, 16.0, preset("vlp-16"), OccupancyConfig())
        return {(ordered[c.first : c.last].tobytes(), c.low, c.high) for c in chunks}

    assert work_of(old) < work_of(np.concatenate([wing, old]))


def test_parts_become_the_files_of_the_whole(tmp_path: Path):
    whole = {"position_m": np.random.default_rng(0).random((10, 3), np.float32), "a": np.arange(10)}
    parts = [{name: array[rows] for name, array in whole.items()} for rows in (slice(0, 4), slice(4, 10))]
    write_templates(iter(parts), 10, tmp_path)
    for name, array in whole.items():
        np.save(tmp_path / "expected.npy", array)
        assert (tmp_path / f"template_{name}.npy").read_bytes() == (tmp_path / "expected.npy").read_bytes()


def test_what_is_there_is_not_made_again(store: Store, log: Path, numbers: StageResult):
    chunks = [Toy(number, str(log)) for number in range(4)]
    told: list[float] = []
    make_chunk(store, STAGE, chunks[1], {"numbers": numbers.directory})
    results = list(run_chunks(Here(store), STAGE, chunks, {"numbers": numbers}, told.append, lambda: False))
    assert [result["sum"].tolist() for result in results] == [[n, n + 1, n + 2] for n in range(4)]
    assert [runs(log, number) for number in range(4)] == [1, 1, 1, 1]
    assert told == [0.5, 0.75, 1.0]
    again = list(run_chunks(Here(store), STAGE, chunks, {"numbers": numbers}, told.append, lambda: False))
    assert [one["sum"].tolist() for one in again] == [one["sum"].tolist() for one in results]
    assert runs(log) == 4
    other = list(run_chunks(Here(store), "8" * 64, chunks, {"numbers": numbers}, told.append, lambda: False))
    assert len(other) == 4
    assert runs(log) == 8, "another stage has its own"


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04", "flip", "cut", "remove"])
def test_a_damaged_result_is_made_again(damage, store: Store, log: Path, numbers: StageResult):
    chunk = Toy(7, str(log))
    make_chunk(store, STAGE, chunk, {"numbers": numbers.directory})
    (key,) = store.list("stages")
    whole = store.get(key)
    if damage == "remove":
        store.delete(key)
    elif damage == "flip":
        at = whole.index(np.arange(7, 10).tobytes())
        store.put(key, whole[:at] + b"\xff" + whole[at + 1 :])
    else:
        store.put(key, whole[: len(whole) // 2] if damage == "cut" else damage)
    (result,) = run_chunks(
        Here(store), STAGE, [chunk], {"numbers": numbers}, lambda fraction: None, lambda: False
    )
    assert result["sum"].tolist() == [7, 8, 9]
    assert runs(log) == 2
    assert store.get(key) == whole, "the same bytes"


def test_a_store_that_forgets_is_given_up(store: Store, log: Path, numbers: StageResult):
    with pytest.raises(StoreError, match="does not keep"):
        list(
            run_chunks(
                Here(store, forgets=True),
                STAGE,
                [Toy(1, str(log))],
                {"numbers": numbers},
                lambda fraction: None,
                lambda: False,
            )
        )
    assert runs(log) == 4


def test_chunks_expire_with_their_stage_and_make_none(store: Store, log: Path, numbers: StageResult):
    make_chunk(store, STAGE, Toy(1, str(log)), {"numbers": numbers.directory})
    assert collect_stages(store, 3600).kept == 1
    (log.parent / "empty").mkdir()
    assert SharedStages(store).fetch(STAGE, log.parent / "empty") is False
    assert collect_stages(store, -1).removed == (STAGE,)
    assert store.list("stages") == []
