"""foxglove.PointCloud in protobuf, written by its own schemas and by mcap's writer of protobuf."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from mcap_protobuf.writer import Writer

from firstfix.errors import InputError, MalformedData, NotFound, TooLarge, UnsupportedFormat
from firstfix.formats.point_cloud import SCAN_LIMITS, Limits
from firstfix.recording.foxglove import foxglove_decoder
from firstfix.recording.messages import PROTOBUF, RawMessage
from firstfix.recording.recording import open_recording
from firstfix.transform import from_quaternion, transform_points
from tests.every_case import every_case
from tests.mcap_files import write_mcap

NS = 10**9
STAMP_NS = 1_730_000_000 * NS + 250_000_000
COUNT = 300
KINDS = ["i1", "u1", "i2", "u2", "i4", "u4"]  # as in foxglove's table the signed ones have the higher codes
LAYOUT = [*((axis, "<f4") for axis in "xyz"), ("t", "<u4"), *((f"v_{kind}", f"<{kind}") for kind in KINDS)]
POINTS = np.zeros(COUNT, LAYOUT)
for _axis in "xyz":
    POINTS[_axis] = np.random.default_rng(ord(_axis)).uniform(-30, 30, COUNT)
POINTS["t"] = np.linspace(0, 99_000_000, COUNT)
for _kind in KINDS:
    POINTS[f"v_{_kind}"] = np.iinfo(_kind).max - np.arange(COUNT) % 100
NAMES = {"i": "INT", "u": "UINT", "f": "FLOAT"}


def message(points: np.ndarray = POINTS) -> PointCloud:
    made = PointCloud(frame_id="lidar", point_stride=points.dtype.itemsize, data=points.tobytes())
    made.timestamp.FromNanoseconds(STAMP_NS)
    for name in points.dtype.names or ():
        kind, offset = points.dtype.fields[name][:2]
        code = PackedElementField.NumericType.Value(f"{NAMES[kind.kind]}{8 * kind.itemsize}")
        made.fields.add(name=name, offset=offset, type=code)
    return made


def written(path: Path, messages: list[PointCloud]) -> Path:
    with path.open("wb") as file, Writer(file) as writer:
        for number, one in enumerate(messages):
            writer.write_message("/cloud", one, log_time=STAMP_NS + number)
    return path


def decoded(one: PointCloud, folder: Path, limits: Limits = SCAN_LIMITS):
    with open_recording(written(folder / "a.mcap", [one])) as recording:
        decode = foxglove_decoder(recording.schema(recording.cloud_topic(None)))
        (raw,) = recording.messages(["/cloud"])
    return decode(raw, limits)


def test_a_recording_is_read(tmp_path: Path):
    with open_recording(written(tmp_path / "a.mcap", [message(), message()])) as recording:
        topic = recording.cloud_topic(None)
        assert (topic.name, topic.type, topic.encoding, topic.count) == (
            "/cloud",
            "foxglove.PointCloud",
            PROTOBUF,
            2,
        )
        first, _ = recording.clouds(topic)
    assert (first.header().stamp.ns, first.header().frame_id, first.time_ns) == (STAMP_NS, "lidar", STAMP_NS)
    scan = first.cloud().scan()
    np.testing.assert_array_equal(scan.points, np.stack([POINTS[axis] for axis in "xyz"], axis=1))
    np.testing.assert_allclose(scan.time_s, POINTS["t"] * 1e-9, atol=1e-8)


def test_every_type_of_number_is_read_as_foxglove_means_it(tmp_path: Path):
    columns = decoded(message(), tmp_path).cloud.columns
    for name in POINTS.dtype.names or ():
        assert columns[name].dtype == POINTS.dtype[name], name
        np.testing.assert_array_equal(columns[name], POINTS[name])


def test_the_pose_is_where_the_cloud_begins_in_its_frame(tmp_path: Path):
    moved = message()
    T = from_quaternion([1.0, -2.0, 0.5], [0.1, 0.2, 0.3, 0.9])
    for name, value in zip("xyz", [1.0, -2.0, 0.5], strict=True):
        setattr(moved.pose.position, name, value)
    for name, value in zip("xyzw", [0.1, 0.2, 0.3, 0.9], strict=True):
        setattr(moved.pose.orientation, name, value)
    expected = transform_points(T, np.stack([POINTS[axis] for axis in "xyz"], axis=1))
    np.testing.assert_allclose(decoded(moved, tmp_path).cloud.xyz, expected, atol=1e-12)
    only_moved = message()
    only_moved.pose.position.x = 2.0
    np.testing.assert_array_equal(
        decoded(only_moved, tmp_path).cloud.xyz[:, 0], POINTS["x"].astype(np.float64) + 2.0
    )
    turned = message()
    turned.pose.orientation.SetInParent()  # four zeros are no turn of any kind
    with pytest.raises(MalformedData, match="no direction"):
        decoded(turned, tmp_path)


def changed(**values: object) -> PointCloud:
    made = message()
    for name, value in values.items():
        setattr(made, name, value)
    return made


def without_z() -> PointCloud:
    made = message()
    del made.fields[2]
    return made


BAD = {
    "no stride": (changed(point_stride=0), MalformedData),
    "a stride that does not fit": (changed(point_stride=13), MalformedData),
    "a huge stride": (changed(point_stride=10**9), MalformedData),
    "fields outside": (changed(point_stride=4), MalformedData),
    "no z": (without_z(), MalformedData),
    "x of integers": (message(POINTS.astype([("x", "<i4"), *LAYOUT[1:]])), UnsupportedFormat),
}


@every_case("name", BAD)
def test_a_bad_message_is_an_input_error(tmp_path_factory: pytest.TempPathFactory, name: str):
    bad, error = BAD[name]
    with pytest.raises(error):
        decoded(bad, tmp_path_factory.mktemp("bag"))


def test_limits_and_damage(tmp_path: Path):
    with pytest.raises(TooLarge, match="300 points, the limit is 100"):
        decoded(message(), tmp_path, Limits(100, 10**6))
    with open_recording(written(tmp_path / "a.mcap", [message()])) as recording:
        schema = recording.schema(recording.cloud_topic(None))
    decode, good, rng = foxglove_decoder(schema), message().SerializeToString(), np.random.default_rng(5)
    for trial in range(200):
        body = bytearray(good)
        if trial % 2:
            body[rng.integers(200)] ^= rng.integers(1, 256)
        else:
            body = body[: rng.integers(len(body))]
        with suppress(InputError):
            decode(RawMessage("/cloud", 0, bytes(body), "foxglove.PointCloud", PROTOBUF), SCAN_LIMITS)
    for size in range(0, len(schema), 97):
        with pytest.raises(MalformedData, match="schema"):
            foxglove_decoder(schema[:size])


def test_the_same_in_json_says_what_is_read(tmp_path: Path):
    path = write_mcap(tmp_path / "a.mcap", [("/cloud", "foxglove.PointCloud", "json", b"{}", 5, b"{}")])
    with (
        open_recording(path) as recording,
        pytest.raises(NotFound, match="record it in protobuf: json is not read"),
    ):
        recording.cloud_topic(None)


@every_case("seconds, nanos", [(-5, 0), (1, -1), (1, NS)])
def test_a_time_that_is_none_is_malformed(tmp_path_factory: pytest.TempPathFactory, seconds: int, nanos: int):
    one = message()
    one.timestamp.seconds, one.timestamp.nanos = seconds, nanos
    with pytest.raises(MalformedData, match="no time since the epoch"):
        decoded(one, tmp_path_factory.mktemp("bag"))
