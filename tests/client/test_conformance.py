"""The golden vectors: made by the generator, passed by the Python client."""

from __future__ import annotations

import json
from pathlib import Path

from clients.conformance.compare import alike, difference
from clients.conformance.generate import FOLDER, write
from clients.conformance.plain_form import plain_form
from tests.every_case import every_case

VECTORS = json.loads((FOLDER / "index.json").read_text())["vectors"]
MAX_FOLDER_BYTES = 400_000


@every_case("vector", VECTORS, ids=lambda vector: vector["name"])
def test_the_python_client_passes(vector):
    assert not difference(FOLDER, vector)


def files(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*.*")}


def test_the_generator_makes_the_same_files(tmp_path):
    """The files are equal, except for the compression of another zstd version."""
    write(tmp_path)
    made, kept = files(tmp_path), files(FOLDER)
    assert set(made) == set(kept)
    made_index, kept_index = json.loads(made.pop("index.json")), json.loads(kept["index.json"])
    assert alike(made_index["vectors"], kept_index["vectors"])
    same_zstd = made_index["made_with"] == kept_index["made_with"]
    for name, content in made.items():
        if name.startswith("bodies/"):
            assert plain_form(content) == plain_form(kept[name]), name
        if same_zstd or not name.endswith(".bin"):
            assert content == kept[name], name


def test_the_folder_is_small_and_holds_nothing_else():
    kept = files(FOLDER)
    assert sum(map(len, kept.values())) < MAX_FOLDER_BYTES
    named = json.dumps(VECTORS)
    assert {name for name in kept if name not in named} == {"index.json"}


def test_a_wrong_answer_is_seen(tmp_path):
    """The comparison fails when vectors are compared with those of another case."""
    by_function: dict[str, list[dict]] = {}
    for vector in VECTORS:
        by_function.setdefault(vector["function"], []).append(vector)
    for function, vectors in by_function.items():
        expectations = [vector["expected"] for vector in vectors]
        other = next((e for e in expectations if e != vectors[0]["expected"]), {"error": "internal"})
        assert difference(FOLDER, {**vectors[0], "expected": other}), function
