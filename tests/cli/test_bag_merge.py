"""Clouds of several LiDARs: which belong together, and the scan that they make."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.errors import InvalidOption, MalformedData, NotFound, TooLarge
from firstfix.scan.scan import MAX_POINTS, Scan
from firstfix.transform import from_quaternion, inverse, transform_points
from firstfix_cli.bags.replay import Replay, Replayed, replay
from tests import ros_samples
from tests.every_case import every_case
from tests.ros_samples import cloud, cloud_of_points, write_bag

MS = 10**6
START = 1_000_000 * MS
FRONT, REAR, TOP = "/front/points", "/rear/points", "/top/points"
BASE_FRONT = from_quaternion([0.4, 0.0, 0.5], [0, 0, 0.1, 0.99])
BASE_REAR = from_quaternion([-0.4, 0.1, 0.3], [0, 0, 0.98, 0.2])
MOUNTED = [("base_link", "front", BASE_FRONT), ("base_link", "rear", BASE_REAR)]
Message = tuple[str, int, object]


def mounted(*given: tuple[str, str, np.ndarray], at_ms: int = 0) -> Message:
    return ("/tf_static", START + at_ms * MS, ros_samples.transforms(given))


def points_of(topic: str, number: int) -> np.ndarray:
    return np.random.default_rng([len(topic), number]).uniform(-5, 5, (4, 3)).astype(np.float32)


def taken(topic: str, number: int, stamp_ms: int, late_ms: int = 5, frame_id: str | None = None) -> Message:
    """A cloud of four points, recorded some time after its stamp."""
    frame = frame_id or topic.split("/")[1]
    message = cloud_of_points(points_of(topic, number), stamp_ns=START + stamp_ms * MS, frame_id=frame)
    return (topic, START + (stamp_ms + late_ms) * MS, message)


def replayed(
    folder: Path,
    messages: list[Message],
    topics: tuple[str, ...] = (FRONT, REAR),
    told: list[str] | None = None,
    kind: str = "mcap",
    **wanted: object,
) -> list[tuple[int, Scan, LocalizeOptions]]:
    """Returns stamp in ms, scan and options of every query."""
    asked: list[tuple[Scan, LocalizeOptions]] = []

    def ask(scan: Scan, options: LocalizeOptions) -> Localization:
        asked.append((scan, options))
        return Localization(Verdict.REJECTED)

    path = write_bag(folder, kind, sorted(messages, key=lambda one: one[1]))
    tell = ([] if told is None else told).append
    answers: list[Replayed] = list(replay(Replay(path, topics, **wanted), ask, LocalizeOptions(), tell))
    return [((one.header.stamp.ns - START) // MS, *query) for one, query in zip(answers, asked, strict=True)]


def is_of(scan: Scan, clouds: dict[str, int]) -> bool:
    """Returns whether the scan is of these clouds, each in the first one's frame."""
    T = {FRONT: BASE_FRONT, REAR: BASE_REAR}
    leading = T[next(iter(clouds))]
    expected = [
        transform_points(inverse(leading) @ T[topic], points_of(topic, number))
        for topic, number in clouds.items()
    ]
    return np.allclose(scan.points, np.concatenate(expected), atol=1e-5)


@pytest.mark.parametrize("kind", ["ros1", "sqlite3 zstd message", "mcap zstd file", "mcap lz4 chunk"])
def test_each_cloud_has_its_mounting_and_its_stamp(tmp_path: Path, kind: str):
    stores = ros_samples.stores_of(kind)
    messages: list[Message] = [("/tf_static", START, ros_samples.transforms(MOUNTED, stores=stores))]
    for number in range(3):
        for topic, offset_ms in ((FRONT, 0), (REAR, 30)):
            stamp_ns = START + (100 * number + offset_ms) * MS
            points = points_of(topic, number)
            sent = cloud_of_points(points, stores=stores, stamp_ns=stamp_ns, frame_id=topic.split("/")[1])
            messages.append((topic, stamp_ns + MS, sent))
    queries = replayed(tmp_path, messages, kind=kind, base_frame="base_link")
    assert [stamp_ms for stamp_ms, *_ in queries] == [0, 100, 200]
    for number, (_, scan, options) in enumerate(queries):
        assert is_of(scan, {FRONT: number, REAR: number})
        np.testing.assert_allclose(scan.time_s, [0] * 4 + [0.03] * 4, atol=1e-6)
        np.testing.assert_allclose(options.T_base_sensor, BASE_FRONT, atol=1e-9)


def test_the_first_topic_leads(tmp_path: Path):
    messages = [mounted(*MOUNTED), taken(FRONT, 0, 40), taken(REAR, 0, 0)]
    ((stamp_ms, scan, _),) = replayed(tmp_path, messages, (REAR, FRONT))
    assert stamp_ms == 0
    assert is_of(scan, {REAR: 0, FRONT: 0})
    np.testing.assert_allclose(scan.time_s, [0] * 4 + [0.04] * 4, atol=1e-6)


def timed(topic: str, times: np.ndarray, stamp_ms: int, name: str = "t") -> Message:
    """A cloud of three points with times."""
    records = np.zeros(3, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), (name, times.dtype.str)])
    records["x"], records[name] = 1, times
    stamp_ns = START + stamp_ms * MS
    return (topic, stamp_ns + 60 * MS, cloud(records, stamp_ns=stamp_ns, frame_id=topic.split("/")[1]))


def test_the_times_of_the_points_stay(tmp_path: Path):
    times = np.array([0, 50 * MS, 90 * MS], np.uint32)
    messages = [mounted(*MOUNTED), timed(FRONT, times, 0), timed(REAR, times / 1e9, -20, "time")]
    ((_, scan, _),) = replayed(tmp_path, messages)
    np.testing.assert_allclose(scan.time_s, [0, 0.05, 0.09, -0.02, 0.03, 0.07], atol=1e-6)
    assert scan.intensity is None


def test_known_times_and_unknown_ones_are_not_mixed(tmp_path: Path):
    times = np.array([0, 50 * MS, 90 * MS], np.uint32)
    unknown = {
        "none": (taken(REAR, 0, -20, late_ms=60), "the clouds of rear have no times of their points: times"),
        "strange": (
            timed(REAR, times * 40, -20),
            r"\(the field t \(uint32, 0 to 3600000000\) was not understood",
        ),
    }
    for name, (other, why) in unknown.items():
        told: list[str] = []
        (tmp_path / name).mkdir()
        clouds = [
            timed(FRONT, times, 0),
            other,
            timed(FRONT, times, 100),
            (other[0], other[1] + 100 * MS, other[2]),
        ]
        *_, (_, scan, _) = replayed(tmp_path / name, [mounted(*MOUNTED), *clouds], told=told)
        assert scan.time_s is None
        assert (scan.time_field is None) == (name == "none")
        assert len([line for line in told if re.search(why, line)]) == 1


def test_clouds_of_one_time_have_no_times(tmp_path: Path):
    messages = [mounted(*MOUNTED), taken(FRONT, 0, 10), taken(REAR, 0, 10)]
    ((_, scan, _),) = replayed(tmp_path, messages)
    assert scan.time_s is None


ORDERS = {
    "the rear driver is slow": {(REAR, n): 180 for n in range(4)},
    "the front driver is slow": {(FRONT, n): 240 for n in range(4)},
    "one cloud is late": {(REAR, 1): 290},
    "clouds overtake each other": {(FRONT, 1): 230, (REAR, 2): 120, (REAR, 0): 260},
}


@every_case("order", ORDERS)
def test_stamps_count_and_not_the_order_of_recording(tmp_path_factory: pytest.TempPathFactory, order: str):
    messages = [mounted(*MOUNTED)]
    for topic, offset_ms in ((FRONT, 0), (REAR, 20)):
        for n in range(4):
            messages.append(taken(topic, n, 100 * n + offset_ms, ORDERS[order].get((topic, n), 5)))
    queries = replayed(tmp_path_factory.mktemp("bag"), messages)
    assert sorted(stamp_ms for stamp_ms, *_ in queries) == [0, 100, 200, 300]
    for stamp_ms, scan, _ in queries:
        assert is_of(scan, {FRONT: stamp_ms // 100, REAR: stamp_ms // 100})


def test_in_a_gap_of_one_lidar_there_is_no_scan(tmp_path: Path):
    told: list[str] = []
    messages = [mounted(*MOUNTED), *(taken(FRONT, n, 100 * n) for n in range(30))]
    messages += [taken(REAR, n, 100 * n + 10) for n in (*range(5), *range(20, 30))]
    queries = replayed(tmp_path, messages, told=told)
    # The last cloud before the gap is 0.09 s before the next of the front, the first after it 0.11 s.
    assert [stamp_ms // 100 for stamp_ms, *_ in queries] == [*range(6), *range(20, 30)]
    (line,) = told
    assert line.startswith("14 clouds of /front/points have no partners within 0.1 s: the nearest of /rear")


def test_every_and_count_are_of_scans(tmp_path: Path):
    messages = [mounted(*MOUNTED)]
    for n in range(9):
        messages += [taken(FRONT, n, 100 * n), taken(REAR, n, 100 * n + 10)]
    queries = replayed(tmp_path, messages, every=2, count=3)
    assert [stamp_ms for stamp_ms, *_ in queries] == [0, 200, 400]


def test_clocks_that_do_not_agree(tmp_path: Path):
    messages = [mounted(*MOUNTED), taken(FRONT, 0, 0)]
    messages.append(taken(REAR, 0, 3_700_000, late_ms=-3_699_999))
    with pytest.raises(
        NotFound, match=r"no partners within 0.1 s: the nearest of /rear/points was 3700\.000 s"
    ):
        replayed(tmp_path, messages)


def test_clouds_without_stamps_are_matched_by_the_time_of_recording(tmp_path: Path):
    def unstamped(topic: str, at_ms: int) -> Message:
        frame = topic.split("/")[1]
        return (topic, START + at_ms * MS, cloud_of_points(points_of(topic, 0), stamp_ns=0, frame_id=frame))

    ((_, scan, _),) = replayed(tmp_path, [mounted(*MOUNTED), unstamped(FRONT, 0), unstamped(REAR, 40)])
    assert is_of(scan, {FRONT: 0, REAR: 0})
    assert scan.time_s is None


def test_fixed_frames_come_in_several_messages_before_and_after(tmp_path: Path):
    messages = [mounted(MOUNTED[0], at_ms=400), mounted(MOUNTED[1]), mounted(MOUNTED[0], at_ms=900)]
    messages += [taken(FRONT, 0, 0), taken(REAR, 0, 0)]
    ((_, scan, _),) = replayed(tmp_path, messages)
    assert is_of(scan, {FRONT: 0, REAR: 0})


MOVED = from_quaternion([0.5, 0.0, 0.5], [0, 0, 0.1, 0.99])
BAD_FRAMES = {
    "missing": (NotFound, [MOUNTED[0]], "'front' and 'rear': they hang on 'base_link' and 'rear'"),
    "none": (NotFound, [], "no chain of static transforms"),
    "a circle": (
        NotFound,
        [("rear", "base_link", BASE_REAR), *MOUNTED],
        "in a circle: 'front' on 'base_link' on 'rear' on 'base_link'",
    ),
    "two places": (
        MalformedData,
        [*MOUNTED, ("base_link", "front", MOVED)],
        "'front' is mounted in two ways, on 'base_link' and on 'base_link'",
    ),
    "two parents": (
        MalformedData,
        [*MOUNTED, ("mast", "rear", BASE_REAR)],
        "'rear' is mounted in two ways, on 'base_link' and on 'mast'",
    ),
}


@every_case("case", BAD_FRAMES)
def test_frames_that_do_not_say_where_a_lidar_is(tmp_path_factory: pytest.TempPathFactory, case: str):
    error, given, why = BAD_FRAMES[case]
    messages = [mounted(one, at_ms=n) for n, one in enumerate(given)]
    messages += [taken(FRONT, 0, 50), taken(REAR, 0, 50)]
    with pytest.raises(error, match=why):
        replayed(tmp_path_factory.mktemp("bag"), messages)


def test_a_message_that_contradicts_itself(tmp_path: Path):
    messages = [mounted(*MOUNTED, ("base_link", "front", MOVED)), taken(FRONT, 0, 0), taken(REAR, 0, 0)]
    with pytest.raises(MalformedData, match="'front' is mounted in two ways"):
        replayed(tmp_path, messages)


def test_the_frames_of_one_robot_can_be_chosen(tmp_path: Path):
    """Two robots in one recording use the same names for their frames."""
    other = ("/other/tf_static", START, ros_samples.transforms([("base_link", "rear", MOVED)]))
    messages = [mounted(*MOUNTED), other, taken(FRONT, 0, 0), taken(REAR, 0, 0)]
    path = tmp_path / "all"
    path.mkdir()
    with pytest.raises(MalformedData, match="contradict each other"):
        replayed(path, messages)
    ((_, scan, _),) = replayed(tmp_path, messages, tf_static="/tf_static")
    assert is_of(scan, {FRONT: 0, REAR: 0})


def test_clouds_of_one_frame_need_no_transform(tmp_path: Path):
    messages = [taken(topic, 0, 0, frame_id="base_link") for topic in (FRONT, REAR)]
    ((_, scan, _),) = replayed(tmp_path, messages)
    np.testing.assert_array_equal(scan.points, np.concatenate([points_of(FRONT, 0), points_of(REAR, 0)]))


def test_three_lidars(tmp_path: Path):
    frames = [*MOUNTED, ("front", "top", np.eye(4))]
    messages = [mounted(*frames)]
    for n in range(3):
        messages += [taken(FRONT, n, 100 * n), taken(REAR, n, 100 * n + 40), taken(TOP, n, 100 * n - 40)]
    queries = replayed(tmp_path, messages, (FRONT, REAR, TOP))
    assert [len(scan) for _, scan, _ in queries] == [12] * 3


def test_a_damaged_cloud_that_is_not_used_does_no_harm(tmp_path: Path):
    messages = [taken(FRONT, n, 100 * n) for n in range(4)]
    messages[1][2].header.frame_id = "x" * 5000  # a text longer than any reader takes
    assert len(replayed(tmp_path, messages, (FRONT,), every=2)) == 2
    (tmp_path / "all").mkdir()
    at_ns = START + 105 * MS
    with pytest.raises(MalformedData, match=f"the message of /front/points recorded at {at_ns} ns"):
        replayed(tmp_path / "all", messages, (FRONT,))


def test_merged_clouds_have_the_limit_of_a_scan(tmp_path: Path):
    half = np.zeros((MAX_POINTS // 2 + 1, 3), np.float32)
    messages = [mounted(*MOUNTED)]
    for topic in (FRONT, REAR):
        sent = cloud_of_points(half, stamp_ns=START, frame_id=topic.split("/")[1])
        messages.append((topic, START, sent))
    with pytest.raises(TooLarge, match="2000002 points"):
        replayed(tmp_path, messages)


@every_case(
    "wanted, why",
    [
        ({"topics": (FRONT, FRONT)}, "once"),
        ({"topics": (FRONT,), "tf_static": "/tf_static"}, "needs several"),
        ({"every": 0}, "--every"),
    ],
)
def test_options_that_contradict_each_other(tmp_path_factory: pytest.TempPathFactory, wanted, why):
    messages = [mounted(*MOUNTED), taken(FRONT, 0, 0), taken(REAR, 0, 0)]
    with pytest.raises(InvalidOption, match=why):
        replayed(tmp_path_factory.mktemp("bag"), messages, **wanted)
