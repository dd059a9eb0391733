"""``firstfix export`` from a running service and from its store; the files are read by their own readers."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix.catalog.recorded_queries import RecordedQueries
from firstfix.store.store import Store
from firstfix.transform import from_quaternion
from plugins.console.tests.export.exported_world import (
    GUESSES,
    POSE,
    T0_NS,
    TRUTH,
    ExportedWorld,
    intensity_at,
    make_exported_world,
)
from tests.commands import firstfix
from tests.service.access_world import KEYED, known
from tests.service.service_world import Service, running_service, served

ONE_S = 1_000_000_000
OWN_COMPONENTS = ("intensity",)  # rerun has them in no archetype
NEEDS_RERUN = "needs rerun-sdk (170 MB): pip install './plugins/console[rerun]'"


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Service, ExportedWorld]]:
    folder = tmp_path_factory.mktemp("served")
    with running_service(folder, zenoh=False) as service:
        yield service, make_exported_world(service.settings.store, folder / "drawn")


@pytest.fixture(params=["service", "store"])
def way(request: pytest.FixtureRequest, exported: tuple[Service, ExportedWorld]) -> list[str]:
    service, world = exported
    return ["--url", service.url] if request.param == "service" else ["--store", world.store]


@pytest.fixture
def world(exported: tuple[Service, ExportedWorld]) -> ExportedWorld:
    return exported[1]


def messages(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Times and messages of each topic, in the order of time."""
    from mcap import reader as mcap_reader
    from mcap_ros2 import decoder

    found: dict[str, list[tuple[int, Any]]] = {}
    with path.open("rb") as file:
        reader = mcap_reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, decoded))
    return found


def rows_in(cloud: Any, *names: str) -> np.ndarray:
    """The numbers of a PointCloud2 with these fields, all of them float32."""
    step = 4 * len(names)
    assert (cloud.point_step, cloud.row_step, cloud.height) == (step, step * cloud.width, 1)
    assert [(field.name, field.offset, field.datatype) for field in cloud.fields] == [
        (name, 4 * place, 7) for place, name in enumerate(names)
    ]
    return np.frombuffer(bytes(cloud.data), "<f4").reshape(-1, len(names))


def points_in(cloud: Any) -> np.ndarray:
    return rows_in(cloud, "x", "y", "z")


def is_intensity_of(intensity: np.ndarray, points: np.ndarray) -> None:
    """Within a step of the 255, but for the brightest and darkest two percent."""
    expected = intensity_at(points)
    low, high = np.percentile(expected, [2, 98])
    np.testing.assert_allclose(intensity, np.clip(expected, low, high), atol=(high - low) / 200)


def pose_of(position: Any, turn: Any) -> np.ndarray:
    return from_quaternion([position.x, position.y, position.z], [turn.x, turn.y, turn.z, turn.w])


def near(points: np.ndarray, expected: np.ndarray, within_m: float) -> None:
    """Both hold the same points, whatever their order."""
    assert len(points) == len(expected)
    for axis in range(3):
        np.testing.assert_allclose(np.sort(points[:, axis]), np.sort(expected[:, axis]), atol=within_m)


def test_an_mcap_holds_the_map_and_every_query(way, world, tmp_path):
    out = tmp_path / "hall.mcap"
    said = firstfix("export", out, "--map", "hall", *way)
    assert "60,000 points" in said.out
    assert "5 recorded queries, 2 of them localized" in said.out
    assert "1 queries have no points" in said.error
    found = messages(out)
    times = [T0_NS + number * ONE_S for number in range(1, 6)]

    ((at, cloud),) = found["/map"]
    assert at == times[0], "the map is there from the first query on"
    assert cloud.header.frame_id == "map"
    rows = rows_in(cloud, "x", "y", "z", "intensity")
    near(rows[:, :3], world.cloud, 1e-3)
    is_intensity_of(rows[:, 3], rows)
    ((_, templates),) = found["/templates"]
    np.testing.assert_allclose(points_in(templates), world.templates, atol=1e-3)
    ((_, way_of_run),) = found["/trajectory"]
    run_at = [[p.pose.position.x, p.pose.position.y, p.pose.position.z] for p in way_of_run.poses]
    np.testing.assert_allclose(run_at, world.trajectory, atol=1e-3)

    one, two, three, four, _ = world.query_ids
    assert [at for at, _ in found["/scan"]] == times[:1]
    np.testing.assert_array_equal(points_in(found["/scan"][0][1]), world.points[one])
    assert found["/scan"][0][1].header.frame_id == "sensor"
    others = found["/scan_not_localized"]
    assert [at for at, _ in others] == times[1:4]
    assert [cloud.header.frame_id for _, cloud in others] == [
        "best_hypothesis",
        "sensor_unplaced",
        "sensor_unplaced",
    ]
    for (_, cloud), query_id in zip(others, (two, three, four), strict=True):
        np.testing.assert_array_equal(points_in(cloud), world.points[query_id])

    placed = [(at, message.transforms[0]) for at, message in found["/tf"]]
    assert [(at, one.child_frame_id) for at, one in placed] == [
        (times[0], "sensor"),
        (times[1], "best_hypothesis"),
        (times[4], "sensor"),
    ]
    for (at, one), T in zip(placed, (POSE, GUESSES[0], POSE), strict=True):
        assert one.header.frame_id == "map"
        assert one.header.stamp.sec * ONE_S + one.header.stamp.nanosec == at
        np.testing.assert_allclose(pose_of(one.transform.translation, one.transform.rotation), T, atol=1e-12)

    assert [at for at, _ in found["/pose"]] == [times[0], times[4]]
    np.testing.assert_allclose(
        np.diag(np.reshape(found["/pose"][0][1].pose.covariance, (6, 6))), np.arange(1, 7) * 1e-4
    )
    assert [len(array.poses) for _, array in found["/hypotheses"]] == [1, 2, 0, 0, 1]
    for pose, T in zip(found["/hypotheses"][1][1].poses, GUESSES, strict=True):
        np.testing.assert_allclose(pose_of(pose.position, pose.orientation), T, atol=1e-12)
    ((at, truth),) = found["/truth"]
    assert at == times[1]
    np.testing.assert_allclose(pose_of(truth.pose.position, truth.pose.orientation), TRUTH, atol=1e-12)

    assert [value.data for _, value in found["/probability"]] == [0.97, 0.9, 0.01, 0.8, 0.97]
    words = [line.msg for _, line in found["/log"]]
    assert [line.level for _, line in found["/log"]] == [20, 30, 30, 20, 20]
    assert (
        words[0]
        == f"{one_of(world, 0)}: localized, probability 0.970; x 12.50, y 3.25, z 1.50 m, yaw 22.9 deg"
    )
    assert "ambiguous (several_places), probability 0.900; 2 hypotheses" in words[1]
    assert "rejected (no_candidate)" in words[2]
    assert "in map attic, not in hall" in words[3]
    assert "its points cannot be shown" in words[4]
    facts = [{pair.key: pair.value for pair in one.status[0].values} for _, one in found["/answer"]]
    assert [fact["query"] for fact in facts] == [one_of(world, number) for number in range(5)]
    assert facts[1]["verdict"] == "ambiguous"
    assert facts[0]["version"] == world.version
    assert facts[0]["option min_probability"] == "0.5"


def one_of(world: ExportedWorld, number: int) -> str:
    return world.query_ids[number]


def in_rerun(reader: Any, timeline: str) -> dict[tuple[str, str], list[tuple[Any, Any]]]:
    """Times and values of each field of each entity, as rerun reads a file, in the order of time."""
    found: dict[tuple[str, str], list[tuple[Any, Any]]] = {}
    for chunk in reader.stream().to_chunks():
        batch = chunk.to_record_batch()
        times = batch.column(timeline).cast("int64").to_pylist() if timeline in batch.schema.names else None
        for name in batch.schema.names:
            if ":" not in name and name not in OWN_COMPONENTS:
                continue
            rows = batch.column(name).to_pylist()
            found.setdefault((chunk.entity_path, name.rpartition(":")[2]), []).extend(
                (None if times is None else times[row], value)
                for row, value in enumerate(rows)
                if value is not None
            )
    for run_of in found.values():
        run_of.sort(key=lambda one: one[0] or 0)
    return found


def test_rerun_opens_the_recording_for_foxglove(world: ExportedWorld, tmp_path: Path):
    pytest.importorskip("rerun", reason=NEEDS_RERUN)
    from rerun.chunk import McapReader

    out = tmp_path / "hall.mcap"
    firstfix("export", out, "--map", "hall", "--store", world.store)
    found = in_rerun(McapReader(out), "message_log_time")
    ((_, cloud),) = found["/map", "positions"]
    near(np.array(cloud), world.cloud, 1e-3)
    ((_, intensity),) = found["/map", "intensity"]
    is_intensity_of(np.array(intensity), np.array(cloud))
    assert len(found["/templates", "positions"]) == 1
    times = [T0_NS + number * ONE_S for number in range(1, 6)]
    at, scan = found["/scan", "positions"][0]
    assert at == times[0]
    np.testing.assert_array_equal(np.array(scan, np.float32), world.points[world.query_ids[0]])
    assert [frame for _, frame in found["/scan", "frame"]] == [["sensor"]]
    placed = {names[0]: number for number, (_, names) in enumerate(found["/tf", "child_frame"])}
    at_sensor = found["/tf", "translation"][placed["sensor"]][1]
    np.testing.assert_allclose(at_sensor, [POSE[:3, 3]], atol=1e-6)
    np.testing.assert_allclose(found["/truth", "translations"][0][1], [TRUTH[:3, 3]], atol=1e-6)
    assert "ambiguous (several_places)" in found["/log", "text"][1][1][0]


def test_a_recording_of_rerun_holds_the_same(way: list[str], world: ExportedWorld, tmp_path: Path):
    pytest.importorskip("rerun", reason=NEEDS_RERUN)
    from rerun.chunk import RrdReader

    out = tmp_path / "hall.rrd"
    firstfix("export", out, "--map", "hall", *way)
    found = in_rerun(RrdReader(out), "time")
    ((at, cloud),) = found["/map/cloud", "positions"]
    assert at is None, "the map is there at all times"
    near(np.array(cloud), world.cloud, 1e-3)
    ((_, intensity),) = found["/map/cloud", "intensity"]
    is_intensity_of(np.array(intensity), np.array(cloud))
    ((_, colours),) = found["/map/cloud", "colors"]
    grey = np.array(colours, np.uint32) >> 8 & 255
    assert np.corrcoef(grey, np.array(intensity))[0, 1] > 0.999, "dark is low"
    times = [T0_NS + number * ONE_S for number in range(1, 6)]
    scans = found["/map/sensor/scan", "positions"]
    assert [at for at, _ in scans] == [times[0], times[4]]
    np.testing.assert_array_equal(np.array(scans[0][1], np.float32), world.points[world.query_ids[0]])
    assert scans[1][1] == []
    placed = found["/map/sensor", "translation"]
    assert [at for at, _ in placed] == [times[0], times[4]]
    np.testing.assert_allclose(placed[0][1], [POSE[:3, 3]], atol=1e-6)
    turn = found["/map/sensor", "quaternion"][0][1][0]
    np.testing.assert_allclose(from_quaternion(POSE[:3, 3], turn), POSE, atol=1e-6)
    guessed = found["/map/best_hypothesis", "translation"]
    assert [at for at, _ in guessed] == times[1:2]
    np.testing.assert_allclose(guessed[0][1], [GUESSES[0][:3, 3]], atol=1e-6)
    ((_, unplaced), _) = found["/sensor_unplaced/scan", "positions"]
    np.testing.assert_array_equal(np.array(unplaced, np.float32), world.points[world.query_ids[2]])
    np.testing.assert_allclose(found["/map/truth", "translation"][0][1], [TRUTH[:3, 3]], atol=1e-6)
    assert [value for _, (value,) in found["/probability", "scalars"]] == [0.97, 0.9, 0.01, 0.8, 0.97]
    assert "ambiguous (several_places)" in found["/log", "text"][1][1][0]


def test_the_newest_queries_and_an_even_part_of_the_map(way, world, tmp_path):
    out = tmp_path / "hall.mcap"
    told = firstfix("export", out, "--map", "hall", *way, "--count", 2, "--points", 9000, "--json").out
    said = json.loads(told.splitlines()[-1])
    assert said["queries"] == 2
    assert 8900 < said["points"] <= 9000
    found = messages(out)
    assert [at for at, _ in found["/probability"]] == [T0_NS + 4 * ONE_S, T0_NS + 5 * ONE_S]
    points = rows_in(found["/map"][0][1], "x", "y", "z", "intensity")
    is_intensity_of(points[:, 3], points)
    for axis, length in enumerate((30, 20, 4)):
        assert np.mean(points[:, axis]) == pytest.approx(length / 2, rel=0.05)


@pytest.mark.parametrize("ending", [".mcap", ".rrd"])
def test_an_existing_file_is_kept_without_force(way: list[str], tmp_path: Path, ending: str):
    if ending == ".rrd":
        pytest.importorskip("rerun", reason=NEEDS_RERUN)
    out = tmp_path / f"hall{ending}"
    out.write_text("mine")
    assert "--force replaces it" in firstfix("export", out, "--map", "hall", *way, code=2).error
    assert out.read_text() == "mine"
    firstfix("export", out, "--map", "hall", *way, "--force")
    assert out.stat().st_size > 100_000
    assert [path.name for path in tmp_path.iterdir()] == [out.name], "nothing else is left"


@pytest.mark.parametrize(
    ("name", "extra", "says"),
    [
        ("hall.bag", ["--map", "hall"], "must end with .mcap or .rrd"),
        ("a.mcap", ["--map", "nowhere"], "no map nowhere"),
        ("a.mcap", ["--map", "hall", "--version", "0" * 64], "000000"),
        ("none/a.mcap", ["--map", "hall"], "No such file or directory"),
    ],
)
def test_a_refused_export_leaves_no_file(way, tmp_path, name, extra, says):
    assert says in firstfix("export", tmp_path / name, *extra, *way, code=2).error
    assert list(tmp_path.iterdir()) == []


def test_a_service_and_a_store_exclude_each_other(world: ExportedWorld, tmp_path: Path):
    both = ["--url", "http://127.0.0.1:9", "--store", world.store]
    told = firstfix("export", tmp_path / "a.mcap", "--map", "hall", *both, code=2).error
    assert "only one of --url and --store" in told


def test_recorded_queries_may_have_a_store_of_their_own(world, tmp_path):
    Store.open(str(tmp_path / "kept")).put("recorded-queries/none", b"")
    arguments = ["export", tmp_path / "a.mcap", "--map", "hall", "--recorded", tmp_path / "kept"]
    assert "--recorded needs --store" in firstfix(*arguments, code=2).error
    said = firstfix(*arguments, "--store", world.store).out
    assert "60,000 points" in said
    assert " 0 recorded queries" in said


def test_a_failed_export_leaves_no_file(world: ExportedWorld, tmp_path: Path, monkeypatch):
    from firstfix.errors import StoreUnavailable

    def gone(self: RecordedQueries, query_id: str) -> bytes:
        raise StoreUnavailable("the store is gone")

    monkeypatch.setattr(RecordedQueries, "body", gone)
    told = firstfix("export", tmp_path / "a.mcap", "--map", "hall", "--store", world.store, code=1).error
    assert "the store is gone" in told
    assert list(tmp_path.iterdir()) == []


def test_one_body_is_in_memory_at_a_time(world: ExportedWorld, tmp_path: Path, monkeypatch):
    from firstfix_console.export import mcap_file

    steps: list[str] = []
    read, write = RecordedQueries.body, mcap_file.McapFile.write_query

    def noted_read(self: RecordedQueries, query_id: str) -> bytes:
        steps.append("read")
        return read(self, query_id)

    def noted_write(self: mcap_file.McapFile, query: Any) -> None:
        steps.append("write")
        write(self, query)

    monkeypatch.setattr(RecordedQueries, "body", noted_read)
    monkeypatch.setattr(mcap_file.McapFile, "write_query", noted_write)
    firstfix("export", tmp_path / "a.mcap", "--map", "hall", "--store", world.store)
    assert steps == ["read", "write"] * 5


def test_an_export_sends_the_key_and_names_a_missing_cloud(tmp_path: Path, monkeypatch):
    with served(tmp_path, zenoh=False, **KEYED) as service:
        arguments = ["export", tmp_path / "hall.mcap", "--map", "hall", "--url", service.url]
        firstfix(*arguments, code=2)
        monkeypatch.setenv("FIRSTFIX_API_KEY", known(service, "build"))
        assert "has no cloud for viewers" in firstfix(*arguments).error
        assert messages(tmp_path / "hall.mcap") == {}


def test_a_damaged_cloud_is_an_error(tmp_path: Path):
    damaged = make_exported_world(str(tmp_path / "store"), tmp_path / "drawn")
    key = f"maps/hall/versions/{damaged.version}/cloud.bin"
    store = Store.open(damaged.store)
    store.put(key, store.get(key)[:1000])
    firstfix("export", tmp_path / "a.mcap", "--map", "hall", "--store", damaged.store, code=2)
    assert not (tmp_path / "a.mcap").exists()


def test_the_service_lists_recorded_queries_as_its_store_does(way, world):
    said = json.loads(firstfix("recorded", "ls", "--json", "--map", "hall", *way).out.splitlines()[-1])
    listed = [one["query_id"] for one in said["queries"]]
    assert listed == sorted(listed), "oldest first"
    stored = RecordedQueries(Store.open(world.store))
    assert listed == [one.query_id for one in stored.each() if one.is_about("hall")]
    assert listed
