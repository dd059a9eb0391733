"""A manifest names a version: the same content gives the same name, other content another."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from firstfix.catalog.manifest import FileEntry, Manifest
from firstfix.errors import CorruptVersion, IncompatibleVersion, InvalidOption


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "sub").mkdir()
    (tmp_path / "a.npy").write_bytes(b"aaaa")
    (tmp_path / "sub" / "b.bin").write_bytes(b"")
    return tmp_path


def test_the_digest_is_of_content_and_config(folder: Path) -> None:
    manifest = Manifest.for_directory(folder, config={"x": 1, "a": [0.1]}, counts={"templates": 3})
    assert set(manifest.files) == {"a.npy", "sub/b.bin"}
    assert manifest.total_bytes == 4
    assert len(manifest.digest) == 64
    assert Manifest.for_directory(folder, counts={"templates": 3}, config={"a": [0.1], "x": 1}) == manifest
    assert Manifest.for_directory(folder, config={"x": 2, "a": [0.1]}).digest != manifest.digest
    (folder / "a.npy").write_bytes(b"aaab")
    assert Manifest.for_directory(folder, config={"x": 1, "a": [0.1]}).digest != manifest.digest


def test_the_digest_stays_the_same_over_releases() -> None:
    manifest = Manifest({"a": FileEntry(1, "0" * 64)}, config={"b": 0.1, "a": "é"}, origin=(1, 2.5, -3))
    assert manifest.to_json() == (
        b'{"bounds":[],"config":{"a":"\\u00e9","b":0.1},"counts":{},"engine":{},'
        b'"files":{"a":{"bytes":1,"sha256":"' + b"0" * 64 + b'"}},"format":9,"origin":[1.0,2.5,-3.0],'
        b'"self_test":{},"sensor":{},"source":{}}'
    )


def test_it_comes_back_as_it_was_written(folder: Path) -> None:
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
def test_what_is_no_json_is_refused(value: object) -> None:
    with pytest.raises(InvalidOption):
        Manifest({}, config={"x": value})


@pytest.mark.parametrize("name", ["../up", "/abs", "a/../b", ".hidden", "manifest.json", "a b", ""])
def test_a_file_name_that_leads_elsewhere_is_refused(name: str) -> None:
    entry = {"bytes": 1, "sha256": "0" * 64}
    data = json.loads(Manifest({}).to_json())
    data["files"] = {name: entry}
    with pytest.raises(CorruptVersion):
        Manifest.from_json(json.dumps(data, sort_keys=True, separators=(",", ":")).encode())
    with pytest.raises(InvalidOption):
        Manifest({name: FileEntry(1, "0" * 64)})


def test_another_format_is_incompatible_not_corrupt() -> None:
    data = json.loads(Manifest({}).to_json())
    for change in (
        {"format": 8},
        {"format": 10},
        {"format": "9"},
        {"format": [9]},
        {"format": 9.0},
        {"format": True},
        {"format": None},
        {"surprise": 1},
    ):
        with pytest.raises(IncompatibleVersion, match="maps rebuild" if "format" in change else "surprise"):
            Manifest.from_json(json.dumps({**data, **change}, sort_keys=True, separators=(",", ":")).encode())


@pytest.mark.parametrize(
    "change",
    [
        {"files": None},
        {"files": {"a": {"bytes": -1, "sha256": "0" * 64}}},
        {"files": {"a": {"bytes": 1.0, "sha256": "0" * 64}}},
        {"files": {"a": {"bytes": 1, "sha256": "short"}}},
        {"files": {"a": {"bytes": 1}}},
        {"origin": ["x"]},
        {"bounds": 3},
    ],
)
def test_a_malformed_manifest_is_corrupt(change: dict[str, object]) -> None:
    data = {**json.loads(Manifest({}).to_json()), **change}
    with pytest.raises(CorruptVersion):
        Manifest.from_json(json.dumps(data, sort_keys=True, separators=(",", ":")).encode())


@pytest.mark.parametrize("data", [b"", b"[]", b"null", b"{", b"\xff", b"{}", b"[" * 100_000])
def test_what_is_no_manifest_is_corrupt(data: bytes) -> None:
    with pytest.raises(CorruptVersion):
        Manifest.from_json(data)


def test_only_the_canonical_form_is_taken() -> None:
    with pytest.raises(CorruptVersion):
        Manifest.from_json(json.dumps(json.loads(Manifest({}).to_json()), indent=1).encode())
