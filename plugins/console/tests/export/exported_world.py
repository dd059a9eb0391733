"""A map with a cloud, and queries about it that a service has recorded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.catalog.recorded_queries import RecordedQueries, RecordedQuery
from firstfix.store.store import Store
from firstfix.transform import make_transform, pose_to_mapping, rotation_z
from firstfix_builder.index.cloud_octree import CloudOctree
from firstfix_builder.mesh.intensity import Intensity

XYZ = "application/vnd.firstfix.xyz"
TIME = "2026-01-01T00:00:{:02d}+00:00"
T0_NS = 1_767_225_600_000_000_000  # of TIME with 0 seconds
POSE = make_transform(rotation_z(0.4), [12.5, 3.25, 1.5])
GUESSES = (
    make_transform(rotation_z(1.0), [2.0, 3.0, 1.0]),
    make_transform(rotation_z(-2.0), [20.0, 3.0, 1.0]),
)
TRUTH = make_transform(rotation_z(1.1), [2.1, 3.1, 1.0])


@dataclass(frozen=True)
class ExportedWorld:
    """``cloud``, ``templates`` and ``trajectory`` of the map "hall", and what was recorded, by query id.

    The intensity of a point of the cloud is ``intensity_at`` its place.
    """

    store: str
    version: str
    cloud: NDArray[np.float64]
    templates: NDArray[np.float64]
    trajectory: NDArray[np.float64]
    points: dict[str, NDArray[np.float32]]
    query_ids: tuple[str, ...]


def scan_points(seed: int, count: int = 400) -> NDArray[np.float32]:
    return np.random.default_rng(seed).uniform(-9, 9, (count, 3)).astype(np.float32)


def intensity_at(points: NDArray[np.floating]) -> NDArray[np.floating]:
    """(n,) from 0 to 3000 along x."""
    return points[:, 0] * 100


def record_query(
    store: str, number: int, points: NDArray[np.float32], answer: Localization, **more: Any
) -> tuple[str, NDArray[np.float32]]:
    body = more.pop("body", points.astype("<f4").tobytes())
    query_id = f"20260101t{number:012d}-0000000a"
    record = {
        "query_id": query_id,
        "time": TIME.format(number),
        "transport": "http",
        "request_id": f"r{number}",
        "trace_id": "",
        "map_id": "hall",
        "media_type": XYZ,
        "content_encoding": "",
        "options": {"min_probability": "0.5"},
        "answer": answer.to_mapping(),
        "body_bytes": len(body),
        "service_version": "1",
        **more,
    }
    RecordedQueries(Store.open(store)).put(RecordedQuery(**record), body)
    return query_id, points


def make_exported_world(store: str, scratch: Path) -> ExportedWorld:
    """Publishes the map and records five queries: localized, ambiguous, rejected, in another map, damaged."""
    scratch.mkdir(parents=True)
    (scratch / "label.txt").write_text("7")
    rng = np.random.default_rng(3)
    cloud = rng.uniform([0, 0, 0], [30, 20, 4], (60_000, 3))
    templates, trajectory = rng.uniform(1, 15, (40, 3)), np.linspace([1, 1, 1], [25, 10, 1], 30)
    marks = {"templates": templates, "trajectory": trajectory}
    intensity = Intensity.of(intensity_at(cloud))
    CloudOctree.of(cloud, marks=marks, intensity=intensity).save(scratch)
    version = Catalog(Store.open(store)).publish("hall", scratch, Manifest.for_directory(scratch))
    localized = Localization(
        Verdict.LOCALIZED,
        T_map_sensor=POSE,
        covariance=np.diag([1.0, 2, 3, 4, 5, 6]) * 1e-4,
        probability=0.97,
        hypotheses=(Hypothesis(POSE, None, 0.97, 3),),
        map_id="hall",
        map_version=version,
    )
    ambiguous = Localization(
        Verdict.AMBIGUOUS,
        (Reason.SEVERAL_PLACES,),
        probability=0.9,
        hypotheses=tuple(Hypothesis(T, None, 0.45, 1, "hall") for T in GUESSES),
        map_id="hall",
    )
    rejected = Localization(Verdict.REJECTED, (Reason.NO_CANDIDATE,), probability=0.01)
    elsewhere = Localization(Verdict.LOCALIZED, T_map_sensor=POSE, probability=0.8, map_id="attic")
    told = {"map_id": "hall", "T_map_sensor": pose_to_mapping(TRUTH)}
    asked = [
        record_query(store, 1, scan_points(1), localized),
        record_query(store, 2, scan_points(2), ambiguous, truth=told),
        record_query(store, 3, scan_points(3), rejected, truth={"map_id": "hall", "T_map_sensor": None}),
        record_query(store, 4, scan_points(4), elsewhere, map_id="hall,attic"),
        record_query(store, 5, scan_points(5, 0), localized, body=b"cut off"),
    ]
    record_query(store, 6, scan_points(6), rejected, map_id="attic")
    return ExportedWorld(
        store,
        version,
        cloud,
        templates,
        trajectory,
        dict(asked),
        tuple(query_id for query_id, _ in asked),
    )
