"""The functions of the vectors for the Python client.

A client in another language needs such a file too. README.md specifies input and output of each function.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.scan.condense import POINTS, condense, describe
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.scan.scan import Scan
from firstfix.transform import from_quaternion
from firstfix.wire import query as wire_query
from firstfix.wire import scan as wire
from firstfix.wire import sequence as wire_sequence
from firstfix.wire.signature import Asked, QuerySignature, SigningKey
from firstfix_client.errors import error_of_problem

from .files import read_body

Vector = Mapping[str, Any]


def run(folder: Path, vector: Vector) -> Any:
    """Returns the result of the vector's function: bytes, or a JSON value.

    Raises:
        Exception: raised by the client. If the vector expects an error, its ``code`` is compared.
    """
    return _FUNCTIONS[vector["function"]](folder, vector["input"], vector.get("parameters", {}))


def scan_of(folder: Path, given: Vector) -> Scan:
    points = np.fromfile(folder / given["points"], "<f4").reshape(-1, 3)
    points = np.tile(points, (given.get("repeat", 1), 1))
    intensity = None if "intensity" not in given else np.fromfile(folder / given["intensity"], "<f4")
    times = None
    if "times" in given:
        first_s, apart_s = given["times"]
        times = (first_s + apart_s * np.arange(len(points))).astype(np.float32)
    return Scan(points, intensity, given.get("stamp_s"), times)


def _encode_scan(folder: Path, given: Vector, parameters: Vector) -> bytes:
    return wire.encode_scan(scan_of(folder, given), **parameters)


def _decode_scan(folder: Path, given: Vector, parameters: Vector) -> bytes:
    return wire.encode_scan(wire.decode_scan(read_body(folder, given["body"])), **parameters)


def _encode_scans(folder: Path, given: Vector, parameters: Vector) -> bytes:
    scans = [
        condense(scan_of(folder, one)) if one.get("compact") else scan_of(folder, one)
        for one in given["scans"]
    ]
    poses = [from_quaternion(one["position"], one["quaternion"]) for one in given["poses"]]
    return wire_sequence.encode_scans(scans, poses, **parameters)


def _decode_scans(folder: Path, given: Vector, parameters: Vector) -> int:
    return len(wire_sequence.decode_scans(read_body(folder, given["body"])).scans)


def _compact_query(folder: Path, given: Vector, parameters: Vector) -> bytes:
    scan = condense(scan_of(folder, given), *_levelling(parameters), points=parameters.get("points", POINTS))
    return wire_query.encode_query(scan, resolution_m=parameters.get("resolution_m", 0.02))


def _descriptor_query(folder: Path, given: Vector, parameters: Vector) -> bytes:
    known, gravity = _levelling(parameters)
    return wire_query.encode_query(describe(scan_of(folder, given), known or DescriptorParameters(), gravity))


def _decode_query(folder: Path, given: Vector, parameters: Vector) -> bytes:
    return wire_query.encode_query(wire_query.decode_query(read_body(folder, given["body"])), **parameters)


def _levelling(parameters: Vector) -> tuple[DescriptorParameters | None, Any]:
    engine, gravity = parameters.get("engine"), parameters.get("gravity")
    return (
        None if engine is None else DescriptorParameters.from_engine(engine),
        None if gravity is None else np.array(gravity, np.float64),
    )


def _descriptor_parameters(folder: Path, given: Vector, parameters: Vector) -> dict[str, Any]:
    known = DescriptorParameters.from_engine(given["engine"])
    assert known.descriptor is not None
    return {
        "min_range_m": known.min_range_m,
        "max_range_m": known.max_range_m,
        "voxel_m": known.voxel_m,
        "default_height_m": known.default_height_m,
        "rings": known.descriptor.grid.rings,
        "sectors": known.descriptor.grid.sectors,
        "descriptor_max_range_m": known.descriptor.grid.max_range_m,
        "layer_edges_m": list(known.descriptor.edges_m),
    }


def _options(folder: Path, given: Vector, parameters: Vector) -> dict[str, str]:
    values: dict[str, Any] = dict(given)
    if "gravity" in values:
        values["gravity"] = np.array(values["gravity"], np.float64)
    if "prior" in values:
        values["prior"] = Prior.from_numbers(values["prior"])
    for name in values.keys() & {"T_base_sensor", "T_odom_base"}:
        values[name] = from_quaternion(values[name]["position"], values[name]["quaternion"])
    if "twist" in values:
        values["twist"] = np.array(values["twist"], np.float64)
    return LocalizeOptions(**values).to_strings()


def _answer(folder: Path, given: Vector, parameters: Vector) -> dict[str, Any]:
    return Localization.from_mapping(json.loads((folder / given["document"]).read_bytes())).to_mapping()


def _geopose(folder: Path, given: Vector, parameters: Vector) -> dict[str, Any]:
    document = json.loads((folder / given["document"]).read_bytes())
    return {
        "position": {name: float(document["position"][name]) for name in ("lat", "lon", "h")},
        "quaternion": {name: float(document["quaternion"][name]) for name in ("x", "y", "z", "w")},
    }


def _problem(folder: Path, given: Vector, parameters: Vector) -> dict[str, Any] | None:
    error = error_of_problem((folder / given["document"]).read_bytes(), given["status"])
    return None if error is None else {"code": error.code, "detail": str(error)}


def _zenoh_query(folder: Path, given: Vector, parameters: Vector) -> dict[str, str]:
    key, payload = _signing_key(given), bytes.fromhex(given["payload"])
    asked = Asked.of(given["key"], [(name, value) for name, value in given["parameters"]], given["encoding"])
    signature = key.sign(asked, payload, given["time_ms"], bytes.fromhex(given["nonce"]))
    return {"attachment": signature.to_bytes().hex()}


def _zenoh_reply(folder: Path, given: Vector, parameters: Vector) -> dict[str, bool]:
    query = QuerySignature.parse(bytes.fromhex(given["attachment"]))
    assert query is not None
    payload = bytes.fromhex(given["payload"])
    return {"is_signed": _signing_key(given).has_replied(query, given["is_ok"], given["encoding"], payload)}


def _signing_key(given: Vector) -> SigningKey:
    key = SigningKey.of_api_key(given["api_key"])
    assert key is not None
    return key


_FUNCTIONS: dict[str, Callable[[Path, Vector, Vector], Any]] = {
    "encode_scan": _encode_scan,
    "decode_scan": _decode_scan,
    "encode_scans": _encode_scans,
    "decode_scans": _decode_scans,
    "compact_query": _compact_query,
    "descriptor_query": _descriptor_query,
    "decode_query": _decode_query,
    "descriptor_parameters": _descriptor_parameters,
    "options": _options,
    "answer": _answer,
    "geopose": _geopose,
    "problem": _problem,
    "zenoh_query": _zenoh_query,
    "zenoh_reply": _zenoh_reply,
}
