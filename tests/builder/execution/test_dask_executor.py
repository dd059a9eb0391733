"""Builds on a real Dask cluster: the same bytes, and the loss of a machine costs only what it was at."""

from __future__ import annotations

import json
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from firstfix.builds.config import BuildConfig, ReconstructConfig
from firstfix.builds.options import BuildOptions
from firstfix.errors import BuildCancelled, BuildFailed, ClusterUnavailable, InvalidOption
from firstfix.store.store import Store
from firstfix_builder.execution.chunks import ChunkCache, ChunkResults, run_chunks
from firstfix_builder.execution.dask_executor import DaskExecutor
from firstfix_builder.execution.stage_cache import StageCache, StageResult
from firstfix_builder.job.build_job import BuildResult
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.mesh.places.tiled_points import TiledPoints
from firstfix_builder.mesh.reconstruct import block_meshes, mesh_chunks
from firstfix_builder.pipeline import build_version
from tests.builder.execution.dask_cluster import DaskCluster, dask_cluster
from tests.builder.execution.toy_chunks import Toy, keyed, runs
from tests.certificates import certificates
from tests.servers import free_port
from tests.small_world import CONFIG
from tests.waiting import wait_until

pytestmark = pytest.mark.slow

REPO = Path(__file__).parents[3]
AWAY_S = 120.0


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskCluster]:
    with dask_cluster(tmp_path_factory.mktemp("dask"), 2, path=(REPO,)) as cluster:
        yield cluster


class Driver:
    """A build's side of it, in a thread: runs chunks and keeps how that ended."""

    def __init__(
        self,
        cluster: DaskCluster,
        store: Path,
        chunks: list[Toy],
        numbers: StageResult,
        away_s: float = AWAY_S,
    ) -> None:
        self.sums: list[int] = []
        self.error: BaseException | None = None
        self.cancelled = threading.Event()
        self._work = (cluster, store, chunks, numbers, away_s)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        cluster, store, chunks, numbers, away_s = self._work
        try:
            with DaskExecutor(cluster.address, str(store), away_s=away_s) as executor:
                results = run_chunks(
                    executor,
                    [keyed(chunk) for chunk in chunks],
                    ChunkResults(executor.store).made(),
                    {"numbers": numbers},
                    lambda fraction: None,
                    self.cancelled.is_set,
                )
                self.sums = [int(result["sum"][0]) for result in results]
        except BaseException as error:
            self.error = error

    def end(self) -> list[int]:
        self._thread.join(2 * AWAY_S)
        assert not self._thread.is_alive()
        if self.error is not None:
            raise self.error
        return self.sums


def test_a_version_is_the_same_as_with_threads(
    cluster: DaskCluster, small_map: Path, small_version: BuildResult, small_work: Path, tmp_path: Path
):
    made = [path.parent for path in (small_work / "stages").glob("*/stage.json")]
    (templates,) = (stage for stage in made if '"make_templates"' in (stage / "stage.json").read_text())
    shutil.rmtree(templates)
    store, told = tmp_path / "store", []
    again = build_version(
        small_map,
        BuildConfig.parse(CONFIG),
        small_work,
        options=BuildOptions(executor=cluster.url, store=str(store)),
        progress=lambda stage, fraction: told.append(stage) if stage == "make_templates" else None,
    )
    assert again.manifest.digest == small_version.manifest.digest
    assert len(told) > 4, "it was made again, in chunks"
    shared = Store.open(str(store))
    kinds = [json.loads(shared.get(key))["stage"] for key in shared.list("stages") if key.endswith(".json")]
    assert sorted(set(kinds)) == ["chunk", "mesh", "viewpoints"], "chunks, and what the workers read"
    assert kinds.count("mesh") == kinds.count("viewpoints") == 1


@pytest.mark.parametrize("surface", ["signed-distance", "poisson"])
def test_a_cloud_becomes_the_same_mesh(cluster: DaskCluster, tmp_path: Path, surface: str):
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(0, 12, (9000, 2)), rng.normal(0, 0.01, 9000)])
    (tmp_path / "map").mkdir()
    TiledPoints.of(points).save(tmp_path / "map")
    read = StageResult("9" * 64, tmp_path / "map", "a" * 64)
    chunks = mesh_chunks(points, None, ReconstructConfig(surface=surface, tile_cells=40))
    assert len(chunks) >= 4

    with DaskExecutor(cluster.address, str(tmp_path / "store")) as executor:
        cache = ChunkCache(StageCache(tmp_path / "cache"), executor)
        parts = list(cache.run("mesh", chunks, {"map": read}, lambda fraction: None, lambda: False))
    far = Mesh.joined(block_meshes(parts))
    near = Mesh.joined(block_meshes(chunk.run({"map": tmp_path / "map"}) for chunk in chunks))
    assert far.vertices.tobytes() == near.vertices.tobytes()
    assert far.triangles.tobytes() == near.triangles.tobytes()


def test_errors_of_a_chunk_reach_the_build(
    cluster: DaskCluster, log: Path, numbers: StageResult, tmp_path: Path
):
    with pytest.raises(BuildFailed, match="cannot be made"):
        Driver(cluster, tmp_path / "store", [Toy(1, str(log), fate="raises")], numbers).end()
    with pytest.raises(ValueError, match="a fault"):
        Driver(cluster, tmp_path / "store", [Toy(1, str(log), fate="breaks")], numbers).end()


def test_a_cancelled_build_begins_no_more_chunks(
    cluster: DaskCluster, log: Path, numbers: StageResult, tmp_path: Path
):
    gate = tmp_path / "gate"
    driver = Driver(cluster, tmp_path / "store", [Toy(n, str(log), str(gate)) for n in range(50)], numbers)
    wait_until(lambda: runs(log) > 0)
    driver.cancelled.set()
    with pytest.raises(BuildCancelled):
        driver.end()
    from distributed import Client

    with Client(cluster.address) as looker:  # the scheduler hears of it by and by
        wait_until(lambda: looker.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.tasks)) == 0)
    begun = runs(log)
    gate.touch()
    assert begun < 50
    free = Driver(cluster, tmp_path / "other", [Toy(100, str(log))], numbers)
    assert free.end() == [100], "the workers are free for another"
    assert runs(log) - 1 <= begun + 2  # what was at a worker already


def test_a_build_that_was_not_connected_to_this_store_is_refused(
    cluster: DaskCluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(Store, "put", lambda self, key, data: None)  # as if it were another's directory
    with pytest.raises(BuildFailed, match="another store"):
        DaskExecutor(cluster.address, str(tmp_path / "store"))


def test_a_store_in_memory_is_no_other_machines():
    with pytest.raises(InvalidOption, match="memory"):
        DaskExecutor("tcp://127.0.0.1:1", "memory://")


def test_workers_that_are_killed_cost_their_chunks(log: Path, numbers: StageResult, tmp_path: Path):
    gate = tmp_path / "gate"
    chunks = [Toy(n, str(log), str(gate) if n == 10 else "") for n in range(20)]
    with dask_cluster(tmp_path / "dask", 0, path=(REPO,)) as cluster:
        first = cluster.start_worker()
        driver = Driver(cluster, tmp_path / "store", chunks, numbers)
        wait_until(lambda: runs(log, 10) == 1)
        cluster.kill_worker(first)
        second = cluster.start_worker()
        wait_until(lambda: runs(log, 10) == 2)
        cluster.kill_worker(second)
        gate.touch()
        cluster.start_worker()
        assert driver.end() == list(range(20))
    assert [runs(log, n) for n in range(20)] == [3 if n == 10 else 1 for n in range(20)]
    assert cluster.log().count("Receive client connection") == 1, "the build noticed nothing"


def test_a_scheduler_that_is_killed_costs_what_was_under_way(log: Path, numbers: StageResult, tmp_path: Path):
    gate = tmp_path / "gate"
    chunks = [*(Toy(n, str(log)) for n in range(10)), Toy(10, str(log), str(gate)), Toy(11, str(log))]
    with dask_cluster(tmp_path / "dask", 1, path=(REPO,)) as cluster:
        driver = Driver(cluster, tmp_path / "store", chunks, numbers)
        wait_until(lambda: runs(log, 10) >= 1)
        cluster.kill_scheduler()
        gate.touch()
        cluster.start_scheduler()
        cluster.start_worker()
        assert driver.end() == list(range(12))
    assert [runs(log, n) for n in range(10)] == [1] * 10
    assert runs(log, 10) == 2
    assert runs(log, 11) == 1


def test_a_scheduler_that_stays_away_is_named_and_the_next_build_goes_on(
    log: Path, numbers: StageResult, tmp_path: Path
):
    gate = tmp_path / "gate"
    chunks = [*(Toy(n, str(log)) for n in range(5)), Toy(5, str(log), str(gate))]
    with dask_cluster(tmp_path / "dask", 1, path=(REPO,)) as cluster:
        cluster.wait_for_workers(1)
        driver = Driver(cluster, tmp_path / "store", chunks, numbers, away_s=8.0)
        wait_until(lambda: runs(log, 5) >= 1)
        cluster.kill_scheduler()
        with pytest.raises(ClusterUnavailable, match=cluster.address):
            driver.end()
        gate.touch()
        store = Store.open(str(tmp_path / "store"))
        assert ChunkResults(store).made() - {numbers.key} == {keyed(chunk).key for chunk in chunks[:5]}
        cluster.start_scheduler()
        cluster.start_worker()
        assert Driver(cluster, tmp_path / "store", chunks, numbers).end() == list(range(6))
    assert [runs(log, n) for n in range(6)] == [1, 1, 1, 1, 1, 2]


def test_a_chunk_that_kills_its_workers_fails_the_build(log: Path, numbers: StageResult, tmp_path: Path):
    once = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1"}  # not 3: workers start slowly
    with dask_cluster(tmp_path / "dask", 2, path=(REPO,), environment=once) as cluster:
        driver = Driver(cluster, tmp_path / "store", [Toy(1, str(log), fate="dies")], numbers)
        with pytest.raises(BuildFailed, match="every worker that ran a certain chunk died"):
            driver.end()
    assert runs(log) == 2


def test_a_cluster_without_scheduler_or_workers_is_unavailable(tmp_path: Path):
    with pytest.raises(ClusterUnavailable, match="no Dask scheduler answers"):
        DaskExecutor(f"tcp://127.0.0.1:{free_port()}", str(tmp_path), away_s=0.0)
    with dask_cluster(tmp_path / "dask", 0) as cluster:
        cluster.wait_for_scheduler()
        with pytest.raises(ClusterUnavailable, match="no workers"):
            DaskExecutor(cluster.address, str(tmp_path), away_s=2.0)


def test_over_tls_both_sides_show_their_certificates(log: Path, numbers: StageResult, tmp_path: Path):
    import distributed  # noqa: F401
    from dask import config  # which has the defaults of distributed from now on

    ca, server, client = certificates(tmp_path)
    (tmp_path / "foreign").mkdir()
    *_, stranger = certificates(tmp_path / "foreign")
    chunks = [Toy(n, str(log)) for n in range(3)]

    def shown(pair: Path) -> dict[str, str]:
        tls = "distributed.comm.tls"
        return {f"{tls}.ca-file": str(ca), f"{tls}.client.cert": str(pair), f"{tls}.client.key": str(pair)}

    with dask_cluster(tmp_path / "dask", 1, path=(REPO,), tls=(ca, server)) as cluster:
        cluster.wait_for_workers(1)
        assert BuildOptions(executor=cluster.url).scheduler == cluster.address
        with config.set(shown(client)):
            assert Driver(cluster, tmp_path / "store", chunks, numbers).end() == [0, 1, 2]
        with (
            config.set(shown(stranger)),
            pytest.raises(ClusterUnavailable, match="no Dask scheduler answers"),
        ):
            DaskExecutor(cluster.address, str(tmp_path / "store"), away_s=1.0)


def test_workers_with_other_code_are_refused(tmp_path: Path):
    root, other = REPO, tmp_path / "other"
    for part in ("core/firstfix", "builder/firstfix_builder"):
        shutil.copytree(root / part, other / Path(part).name)
    with (other / "firstfix_builder" / "templates.py").open("a") as file:
        file.write("# another line\n")
    with dask_cluster(tmp_path / "dask", 1) as cluster:
        cluster.start_worker(other)
        cluster.wait_for_workers(2)
        with pytest.raises(BuildFailed, match=r"has code \w+ where \w+ is needed"):
            DaskExecutor(cluster.address, str(tmp_path / "store"))
