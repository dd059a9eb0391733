"""Writes ``vectors/``: run ``python -m clients.conformance.generate`` in the repository's root.

The expected results are those of the Python client. If they change, the protocol has changed. Vectors of the
decoders (``decode_...``) encode the decoded value again and compare the bytes.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import zstandard

from . import cases, damage, documents, files, signatures
from .python_client import run

FOLDER = Path(__file__).resolve().parent / "vectors"

Vector = dict[str, Any]


def write(folder: Path) -> None:
    """Writes all vectors and their index into an empty or missing folder."""
    _store(folder, {**cases.inputs(), **documents.documents()})
    encoded = [*cases.scans(), *cases.range_images(), *cases.sequences(), *cases.queries()]
    encoded += cases.timed()
    index = [_expecting_body(folder, vector) for vector in encoded]
    index += [_read_back(vector) for vector in index if _can_be_read_back(vector)]
    index += _damaged(folder)
    for vector in (*cases.parameters(), *documents.vectors(), *signatures.vectors()):
        index.append(
            vector if "expected" in vector else {**vector, "expected": {"value": run(folder, vector)}}
        )
    zstd = ".".join(map(str, zstandard.ZSTD_VERSION))
    listing = {"format": 1, "made_with": {"libzstd": zstd}, "vectors": index}
    _store(folder, {"index.json": json.dumps(listing, indent=0).encode() + b"\n"})


def _expecting_body(folder: Path, vector: Vector) -> Vector:
    if "expected" in vector:
        return vector
    path = f"bodies/{vector['name']}.bin"
    _store(folder, {path: run(folder, vector)})
    return {**vector, "expected": {"body": path}}


def _can_be_read_back(vector: Vector) -> bool:
    """Returns whether the decoded scan is encoded to the same bytes again.

    Rounding changes the scale of real intensities, and the poses of sequences.
    """
    given = vector["input"]
    if "body" not in vector["expected"] or given.get("intensity", "").endswith(("real.f32", "unusual.f32")):
        return False
    return vector["function"] != "encode_scans"


def _read_back(vector: Vector) -> Vector:
    function = "decode_scan" if vector["function"] == "encode_scan" else "decode_query"
    parameters = vector.get("parameters", {})
    return {
        "name": f"back-{vector['name']}",
        "function": function,
        "input": {"body": vector["expected"]["body"]},
        "parameters": {name: parameters[name] for name in ("form", "resolution_m") if name in parameters},
        "expected": vector["expected"],
    }


def _damaged(folder: Path) -> list[Vector]:
    scan, image, compact, described, sequence = (
        (folder / f"bodies/{name}.bin").read_bytes()
        for name in ("scan-edges", "image-edges", "compact-edges", "descriptor-edges", "scans-three")
    )
    timed_scan, timed_image, timed_query = (
        (folder / f"bodies/timed-{name}.bin").read_bytes()
        for name in ("scan-across", "image-edges", "compact-edges")
    )
    index: list[Vector] = []
    bodies: dict[str, bytes] = {}
    for kind, damaged, what in (
        ("scan", damage.damaged_scans(scan), ""),
        ("scan", damage.damaged_range_images(image), ""),
        ("query", damage.damaged_queries(compact, described), ""),
        ("scans", damage.damaged_sequences(sequence, described), ""),
        ("scan", damage.damaged_times(timed_scan, 6), "points-"),
        ("scan", [*damage.damaged_times(timed_image, 6)][-3:], "image-"),
        ("query", [*damage.damaged_times(timed_query, len(compact))][-4:], ""),
    ):
        vectors, more = damage.vectors(kind, damaged, what)
        index += vectors
        bodies |= more
    _store(folder, {files.DAMAGED: files.packed(bodies)})
    return index


def _store(folder: Path, contents: dict[str, bytes]) -> None:
    for name, content in contents.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def main() -> None:
    """Replaces ``vectors/``."""
    with TemporaryDirectory() as made:
        write(Path(made) / "vectors")
        shutil.rmtree(FOLDER, ignore_errors=True)
        shutil.copytree(Path(made) / "vectors", FOLDER)


if __name__ == "__main__":
    main()
