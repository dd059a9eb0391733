"""Vectors of the encodings: scans, functions and parameters."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import scenes

Vector = dict[str, Any]

ENGINE: Vector = {
    "descriptor": {
        "kind": "occupancy",
        "rings": 20,
        "sectors": 60,
        "max_range_m": 60.0,
        "layer_edges_m": [0.3, 1.0, 1.8, 3.0, 6.0, 25.0],
        "coefficients": 8,
    },
    "preprocess": {
        "min_range_m": 0.5,
        "max_range_m": 100.0,
        "voxel_m": 0.25,
        "min_points": 200,
        "default_height_m": 1.0,
    },
}
# No number divides another one, and the number of bits is not a multiple of 8.
ODD_ENGINE: Vector = {
    "descriptor": {
        "kind": "occupancy",
        "rings": 7,
        "sectors": 37,
        "max_range_m": 23.7,
        "layer_edges_m": [-0.1, 0.45, 2.1, 9.0],
        "coefficients": 8,
    },
    "preprocess": {
        "min_range_m": 0.3,
        "max_range_m": 31.3,
        "voxel_m": 0.1,
        "min_points": 200,
        "default_height_m": 0.7,
    },
}


def inputs() -> dict[str, bytes]:
    """Returns the files of points and intensities: float32, little-endian."""
    edges = scenes.edges()
    rng = np.random.default_rng(9)
    unusual = (rng.random(len(edges)) * 3 - 1).astype(np.float32)
    unusual[:4] = np.nan, np.inf, -np.inf, 1e30
    arrays: dict[str, NDArray[np.floating]] = {
        "room": scenes.room(),
        "street": scenes.street(),
        "edges": edges,
        "near-edges": scenes.near_edges(),
        "far": scenes.far(),
        "across": scenes.across(),
        "all-directions": scenes.all_directions(),
        "none": np.zeros((0, 3)),
        "reflectivity-8-bit": np.floor(rng.random(len(edges)) * 256),
        "reflectivity-16-bit": np.floor(rng.random(len(edges)) * 65_536),
        "reflectivity-real": np.rint(rng.random(len(edges)) * 4096) / 4096,
        "reflectivity-unusual": unusual,
        "not-finite": np.array([[1.0, np.nan, 2.0]]),
        "too-far": np.array([[1.0, 2.0, 1001.0]]),
    }
    return {f"inputs/{name}.f32": array.astype("<f4").tobytes() for name, array in arrays.items()}


def scans() -> Iterator[Vector]:
    """Vectors of ``encode_scan`` with points."""
    yield _scan("scan-room", "room", stamp_s=1_700_000_000.25)
    yield _scan("scan-street-coarse", "street", resolution_m=0.02)
    yield _scan("scan-street-thinned", "street", voxel_m=0.5)
    yield _scan("scan-room-fine-and-thinned", "room", resolution_m=0.001, voxel_m=0.25)
    yield _scan("scan-edges", "edges")
    for name in ("8-bit", "16-bit", "real", "unusual"):
        yield _scan(f"scan-reflectivity-{name}", "edges", intensity=f"inputs/reflectivity-{name}.f32")
    yield _scan("scan-thinned-reflectivity", "edges", intensity="inputs/reflectivity-real.f32", voxel_m=5.0)
    yield _scan("scan-moved-origin", "far")
    yield _scan("scan-four-bytes", "across")
    yield _scan("scan-without-points", "none", stamp_s=0.0)
    for name, error, changes in (
        ("resolution-too-fine", "invalid_option", {"resolution_m": 0.00001}),
        ("voxel-too-large", "invalid_option", {"voxel_m": 10.5}),
    ):
        yield {**_scan(f"scan-{name}", "edges", **changes), "expected": {"error": error}}
    for name in ("not-finite", "too-far"):
        yield {**_scan(f"scan-{name}", name), "expected": {"error": "invalid_scan"}}


def range_images() -> Iterator[Vector]:
    """Vectors of ``encode_scan`` with range images."""
    yield _image("image-room", "room", stamp_s=1_700_000_000.25)
    yield _image("image-street", "street", resolution_m=0.02)
    yield _image("image-street-twice", "street", repeat=2)
    yield _image("image-room-fine-and-thinned", "room", resolution_m=0.005, voxel_m=0.25)
    yield _image("image-edges", "edges")
    yield _image("image-without-reflectivity", "edges", intensity="inputs/reflectivity-8-bit.f32")
    yield _image("image-of-all-directions", "all-directions", resolution_m=0.1)
    yield _image("image-beyond-its-reach", "across", resolution_m=0.01)
    yield _image("image-far", "far")
    yield _image("image-without-points", "none", stamp_s=0.0)
    refused = {"expected": {"error": "invalid_option"}}
    yield {**_image("image-resolution-too-fine", "edges", resolution_m=0.004), **refused}
    yield {**_scan("scan-of-no-form", "edges", form="smoke"), **refused}
    for name in ("not-finite", "too-far"):
        yield {**_image(f"image-{name}", name), "expected": {"error": "invalid_scan"}}


def sequences() -> Iterator[Vector]:
    """Vectors of ``encode_scans``. No arithmetic rounds these quaternions."""
    poses = [
        {"position": [0.0, 0.0, 0.0], "quaternion": [0.0, 0.0, 0.0, 1.0]},
        {"position": [1.5, -0.25, 0.125], "quaternion": [0.5, 0.5, 0.5, 0.5]},
        {"position": [-2.0, 300.0, 0.1], "quaternion": [0.0, 0.0, 1.0, 0.0]},
    ]
    far, edges = {"points": "inputs/far.f32"}, {"points": "inputs/near-edges.f32"}
    yield _sequence("scans-three", [far, {**edges, "stamp_s": 12.5}, far], poses)
    yield _sequence("scans-one-compact", [{**edges, "compact": True}, edges], poses[:2], voxel_m=0.5)
    images = [{**edges, "compact": True}, edges, far]
    yield _sequence("scans-range-images", images, poses, form="range_image", resolution_m=0.05)
    yield {**_sequence("scans-none", [], []), "expected": {"error": "invalid_scan"}}
    yield {**_sequence("scans-a-pose-missing", [far, far], poses[:1]), "expected": {"error": "invalid_scan"}}
    yield {**_sequence("scans-too-many", [edges] * 17, poses[:1] * 17), "expected": {"error": "too_large"}}


def queries() -> Iterator[Vector]:
    """Vectors of ``compact_query`` and ``descriptor_query``."""
    for scene in ("room", "street"):
        yield _query("compact_query", f"compact-{scene}", scene)
    yield _query("compact_query", "compact-few-points", "room", points=501, resolution_m=0.05)
    yield _query("compact_query", "compact-many-points", "room", repeat=12, engine=ODD_ENGINE)
    yield _query("compact_query", "compact-edges", "near-edges")
    yield _query("compact_query", "compact-without-points", "none")
    yield _query(
        "compact_query", "compact-described", "room", points=600, engine=ENGINE, gravity=[0, 0, -9.81]
    )
    yield _query("descriptor_query", "descriptor-edges", "near-edges", engine=ENGINE, gravity=[0, 0, -1])
    for scene in ("room", "street"):
        for name, engine in (("usual", ENGINE), ("odd", ODD_ENGINE)):
            yield _query("descriptor_query", f"descriptor-{scene}-{name}", scene, engine=engine)
    for name, gravity in (
        ("tilted", [0.9, -0.4, -9.7]),
        ("on-its-side", [9.8, 0, 0.1]),
        ("hanging", [0, 0, 9.81]),
    ):
        vector = _query("descriptor_query", f"descriptor-{name}", "room", engine=ENGINE, gravity=gravity)
        yield vector
    yield _query("descriptor_query", "descriptor-many-points", "street", repeat=11, engine=ENGINE)
    yield _query("descriptor_query", "descriptor-without-points", "none", engine=ENGINE)
    refused = {"expected": {"error": "invalid_option"}}
    yield {**_query("compact_query", "compact-no-points-wanted", "room", points=0), **refused}
    yield {**_query("compact_query", "compact-resolution-too-fine", "room", resolution_m=0.001), **refused}
    yield {**_query("descriptor_query", "descriptor-of-no-map", "room"), **refused}


def timed() -> Iterator[Vector]:
    """Vectors of all encodings, for scans whose points have times: that of the first one, and between two."""
    yield _scan("timed-scan-street-thinned", "street", times=[-0.05, 2.2e-5], voxel_m=5.0, stamp_s=0.25)
    reflectivity = "inputs/reflectivity-8-bit.f32"
    yield _scan("timed-scan-edges", "edges", times=[-0.9, 0.033], intensity=reflectivity)
    yield _scan("timed-scan-across", "across", times=[1.0, -1.0])
    yield _scan("timed-scan-without-points", "none", times=[0.0, 0.0])
    yield _image("timed-image-of-all-directions", "all-directions", times=[0.0, 2e-7], stamp_s=0.5)
    yield _image("timed-image-edges", "edges", times=[0.1, 1e-7])
    yield _image("timed-image-without-points", "none", times=[0.0, 0.0])
    yield _query("compact_query", "timed-compact-room", "room", times=[-0.1, 2.5e-5], points=51)
    yield _query("compact_query", "timed-compact-edges", "near-edges", times=[0.0, 0.001])
    yield _query("compact_query", "timed-compact-without-points", "none", times=[0.0, 0.0])
    described = {"points": 20, "engine": ENGINE, "gravity": [0, 0, -9.81]}
    yield _query("compact_query", "timed-compact-described", "near-edges", times=[0.0, 0.01], **described)
    poses = [
        {"position": [0.0, 0.0, 0.0], "quaternion": [0.0, 0.0, 0.0, 1.0]},
        {"position": [1.5, -0.25, 0.125], "quaternion": [0.5, 0.5, 0.5, 0.5]},
    ]
    given = {"points": "inputs/near-edges.f32", "times": [-0.02, 0.001]}
    yield _sequence("timed-scans", [{**given, "compact": True}, given], poses)
    refused = {"expected": {"error": "invalid_scan"}}
    yield {**_scan("timed-scan-too-late", "edges", times=[1.0, 0.001]), **refused}
    yield {**_image("timed-image-too-early", "edges", times=[-1.001, 0.0]), **refused}
    yield {**_query("compact_query", "timed-compact-too-late", "room", times=[2.0, 0.0]), **refused}


def parameters() -> Iterator[Vector]:
    """Vectors of ``descriptor_parameters``, from a map's manifest."""
    for name, engine in (("usual", ENGINE), ("odd", ODD_ENGINE)):
        yield {"name": f"parameters-{name}", "function": "descriptor_parameters", "input": {"engine": engine}}
    other = {**ENGINE, "descriptor": {**ENGINE["descriptor"], "kind": "pca_sc"}}
    unusable = {"expected": {"error": "unsupported_format"}}
    yield {
        "name": "parameters-paper",
        "function": "descriptor_parameters",
        "input": {"engine": other},
        **unusable,
    }
    yield {
        "name": "parameters-none",
        "function": "descriptor_parameters",
        "input": {"engine": {}},
        **unusable,
    }


def _scan(name: str, scene: str, **more: Any) -> Vector:
    given: Vector = {key: more.pop(key) for key in ("stamp_s", "intensity", "repeat", "times") if key in more}
    given = {"points": f"inputs/{scene}.f32", **given}
    return {"name": name, "function": "encode_scan", "input": given, "parameters": more}


def _image(name: str, scene: str, **more: Any) -> Vector:
    return _scan(name, scene, form="range_image", **more)


def _sequence(name: str, scans: list[Vector], poses: list[Vector], **parameters: Any) -> Vector:
    given = {"scans": scans, "poses": poses}
    return {"name": name, "function": "encode_scans", "input": given, "parameters": parameters}


def _query(function: str, name: str, scene: str, **more: Any) -> Vector:
    given: Vector = {"points": f"inputs/{scene}.f32"}
    given |= {key: more.pop(key) for key in ("repeat", "times") if key in more}
    return {"name": name, "function": function, "input": given, "parameters": more}
