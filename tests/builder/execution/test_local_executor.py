"""Chunks on this machine: kept as they come, stopped between two."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import ClassVar

import pytest

from firstfix.errors import BuildCancelled, BuildFailed
from firstfix_builder.execution.chunks import ChunkBatch, ChunkResults, run_chunks
from firstfix_builder.execution.local_executor import LocalExecutor
from firstfix_builder.execution.stage_cache import StageResult
from tests.builder.execution.toy_chunks import Toy, keyed, runs
from tests.disk_image import DiskImage, why_no_images
from tests.waiting import let_pass


@dataclass(frozen=True)
class Heavy(Toy):
    keeps_interpreter: ClassVar[bool] = True


@pytest.fixture
def executor(tmp_path: Path) -> Iterator[LocalExecutor]:
    with (
        ThreadPoolExecutor(1) as threads,
        ProcessPoolExecutor(1, mp_context=get_context("spawn")) as processes,
    ):
        yield LocalExecutor(tmp_path / "work", threads, processes)


def sums(
    executor: LocalExecutor, chunks: list[Toy], numbers: StageResult, cancelled=lambda: False
) -> list[int]:
    made = ChunkResults(executor.store).made()
    results = run_chunks(
        executor,
        [keyed(chunk) for chunk in chunks],
        made,
        {"numbers": numbers},
        lambda fraction: None,
        cancelled,
    )
    return [int(result["sum"][0]) for result in results]


def test_results_come_in_order(executor: LocalExecutor, log: Path, numbers: StageResult):
    assert sums(executor, [Toy(n, str(log)) for n in (3, 1, 2)], numbers) == [3, 1, 2]


def test_a_fault_costs_only_what_was_not_done(executor: LocalExecutor, log: Path, numbers: StageResult):
    with pytest.raises(BuildFailed, match="cannot be made"):
        sums(executor, [Toy(1, str(log)), Toy(2, str(log), fate="raises"), Toy(3, str(log))], numbers)
    assert sums(executor, [Toy(1, str(log)), Toy(2, str(log)), Toy(3, str(log))], numbers) == [1, 2, 3]
    assert runs(log, 1) == 1


def test_a_cancelled_build_begins_no_more_chunks(
    executor: LocalExecutor, log: Path, numbers: StageResult, tmp_path: Path
):
    gate = tmp_path / "gate"

    def cancelled() -> bool:
        if runs(log) and not gate.exists():
            gate.touch()
            return True
        return False

    with pytest.raises(BuildCancelled):
        sums(executor, [Toy(n, str(log), str(gate)) for n in range(9)], numbers, cancelled)
    assert runs(log) < 9


def test_a_process_that_dies_fails_the_build(executor: LocalExecutor, log: Path, numbers: StageResult):
    assert sums(executor, [Heavy(4, str(log))], numbers) == [4]
    with pytest.raises(BuildFailed, match="worker process died"):
        sums(executor, [Heavy(5, str(log), fate="dies")], numbers)


def test_a_folder_that_takes_nothing_fails_the_build(
    executor: LocalExecutor, log: Path, numbers: StageResult, tmp_path: Path
):
    (tmp_path / "work" / "chunks" / "stages").write_text("in the way")
    with pytest.raises(BuildFailed, match="cannot write to the work folder"):
        executor.run(ChunkBatch([keyed(Toy(1, str(log)))], {"numbers": numbers}, lambda: None, lambda: False))


def test_results_stay_and_are_pruned_by_size(
    executor: LocalExecutor, log: Path, numbers: StageResult, tmp_path: Path
):
    assert sums(executor, [Toy(n, str(log)) for n in (1, 2)], numbers) == [1, 2]
    with ThreadPoolExecutor(1) as threads:
        again = LocalExecutor(tmp_path / "work", threads, threads)
        assert sums(again, [Toy(n, str(log)) for n in (1, 2)], numbers) == [1, 2]
        assert runs(log) == 2
        assert len(ChunkResults(again.store).made()) == 2
        small = LocalExecutor(tmp_path / "work", threads, threads, max_bytes=1)
        assert ChunkResults(small.store).made() == set()


def test_a_result_that_a_power_cut_has_torn_is_made_again(
    executor: LocalExecutor, log: Path, numbers: StageResult, tmp_path: Path
):
    chunk = keyed(Toy(7, str(log)))
    folder = tmp_path / "work" / "chunks" / "stages" / chunk.key
    for what in ("*.json", "[!s]*"):
        for torn in (b"", b"\0" * 300, None):
            assert sums(executor, [chunk.chunk], numbers) == [7]
            (file,) = folder.glob(what)
            before = runs(log)
            file.unlink() if torn is None else file.write_bytes(torn)
            assert sums(executor, [chunk.chunk], numbers) == [7]
            assert runs(log) == before + 1


@pytest.mark.slow
def test_a_build_goes_on_after_a_power_cut(log: Path, numbers: StageResult, tmp_path: Path):
    if why := why_no_images():
        pytest.skip(why)
    disk = DiskImage.make(tmp_path / "image", tmp_path / "disk", size_bytes=64 << 20)
    chunks = [Toy(number, str(log)) for number in range(60)]
    with ThreadPoolExecutor(2) as threads:
        with disk:
            before = LocalExecutor(disk.mount_point, threads, threads)
            assert sums(before, chunks[:40], numbers) == list(range(40))
            let_pass(3.0)  # the journal is written each second
            assert sums(before, chunks, numbers) == list(range(60))
            disk.cut_power()
        with disk:
            after = LocalExecutor(disk.mount_point, threads, threads)
            assert sums(after, chunks, numbers) == list(range(60))
            made = runs(log)
            assert sums(after, chunks, numbers) == list(range(60))
            assert runs(log) == made > 60, "the cut took nothing"
    assert disk.is_whole()
