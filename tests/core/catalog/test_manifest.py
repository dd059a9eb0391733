"""A manifest names a version: the same content gives the same name, other content another."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix.catalog.manifest import FileEntry, Manifest
from firstfix.errors import CorruptVersion, IncompatibleVersion, InvalidOption
from tests.core.fixtures import make_version


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    make_version(tmp_path, b"aaaa", {"sub/b.bin": b""})
    return tmp_path


def rewritten(**changes: Any) -> bytes:
    """The manifest of an empty version with other values."""
    values = {**json.loads(Manifest({}).to_json()), **changes}
    return json.dumps(values, sort_keys=True, separators=(",", ":")).encode()


def test_the_digest_is_of_content_and_config(folder: Path):
    manifest = Manifest.for_directory(folder, config={"x": 1, "a": [0.1]}, counts={"templates": 3})
    assert set(manifest.files) == {"a.npy", "sub/b.bin"}
    assert manifest.total_bytes == 4
    assert len(manifest.digest) == 64
    assert Manifest.for_directory(folder, counts={"templates": 3}, config={"a": [0.1], "x": 1}) == manifest
    assert Manifest.for_directory(folder, config={"x": 2, "a": [0.1]}).digest != manifest.digest
    (folder / "a.npy").write_bytes(b"aaab")
    assert Manifest.for_directory(folder, config={"x": 1, "a": [0.1]}).digest != manifest.digest


def test_the_digest_stays_the_same_over_releases():
    manifest = Manifest({"a": FileEntry(1, "0" * 64)}, config={"b": 0.1, "a": "é"}, origin=(1, 2.5, -3))
    assert manifest.to_json() == (
        b'{"bounds":[],"config":{"a":"\\u00e9","b":0.1},"counts":{},"engine":{},'
        b'"files":{"a":{"bytes":1,"sha256":"' + b"0" * 64 + b'"}},"format":9,"origin":[1.0,2.5,-3.0],'
        b'"self_test":{},"sensor":{},"source":{}}'
    )


def test_a_manifest_is_read_from_its_json(folder: Path):
    manifest = Manifest.for_directory(
        folder,
        engine={"rings": np.int64(20), "scales": np.array([1.5, 2]), "pair": (1, 2)},
        origin=np.array([100, 200, 0]),
        bounds=np.array([[0, 0, 0], [1, 2, 3]], np.float32),
    )
    (folder / "manifest.json").write_bytes(manifest.to_json())
    assert Manifest.from_json((folder / "manifest.json").read_bytes()) == manifest
    assert manifest.engine == {"rings": 20, "scales": [1.5, 2.0], "pair": [1, 2]}
    assert manifest.bounds == ((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))
    assert Manifest.for_directory(folder).files == manifest.files  # it does not list itself


@pytest.mark.parametrize("value", [float("nan"), float("inf"), {1, 2}, b"bytes"])
def test_a_value_that_json_has_not_is_refused(value: object):
    with pytest.raises(InvalidOption):
        Manifest({}, config={"x": value})


@pytest.mark.parametrize("name", ["../up", "/abs", "a/../b", ".hidden", "manifest.json", "a b", ""])
def test_a_file_name_that_leads_elsewhere_is_refused(name: str):
    with pytest.raises(CorruptVersion):
        Manifest.from_json(rewritten(files={name: {"bytes": 1, "sha256": "0" * 64}}))
    with pytest.raises(InvalidOption):
        Manifest({name: FileEntry(1, "0" * 64)})


@pytest.mark.parametrize(
    "change", [{"surprise": 1}, *({"format": value} for value in (8, 10, "9", [9], 9.0, True, None))]
)
def test_another_format_is_incompatible_not_corrupt(change: dict[str, object]):
    with pytest.raises(IncompatibleVersion, match="maps rebuild" if "format" in change else "surprise"):
        Manifest.from_json(rewritten(**change))


@pytest.mark.parametrize(
    "data",
    [
        rewritten(files=None),
        rewritten(files={"a": {"bytes": -1, "sha256": "0" * 64}}),
        rewritten(files={"a": {"bytes": 1.0, "sha256": "0" * 64}}),
        rewritten(files={"a": {"bytes": 1, "sha256": "short"}}),
        rewritten(files={"a": {"bytes": 1}}),
        rewritten(origin=["x"]),
        rewritten(bounds=3),
        json.dumps(json.loads(Manifest({}).to_json()), indent=1).encode(),  # not the canonical form
        *(b"", b"[]", b"null", b"{", b"\xff", b"{}"),
        pytest.param(b"[" * 100_000, id="deep"),
    ],
)
def test_a_malformed_manifest_is_corrupt(data: bytes):
    with pytest.raises(CorruptVersion):
        Manifest.from_json(data)
