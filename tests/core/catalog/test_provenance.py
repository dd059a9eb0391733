"""Provenance of a version, as its publication records it."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.described import map_details, map_summary, version_details, version_summary
from firstfix.catalog.log.map_log import ENTRIES_PER_SNAPSHOT
from firstfix.catalog.manifest import Manifest
from firstfix.catalog.provenance import MAX_NOTE_CHARS, Provenance, check_note
from firstfix.errors import InvalidOption, NotFound
from firstfix.store.store import Store

MADE = Provenance(
    "hall.laz",
    1234,
    "ab" * 32,
    "poses.txt",
    "before the move",
    "0.1.0",
    "key:0123456789ab",
    "pc7",
    "firstfix build",
)
TESTED = {
    "found": 0.99,
    "localized": 0.9,
    "threshold": {
        "min_probability": 0.95,
        "max_false_accept": 0.005,
        "bound": 0.0027,
        "kept_by": "rate",
        "others": [],
    },
}


def put(catalog: Catalog, folder: Path, label: str = "1", **values: object) -> str:
    (folder / label).mkdir(parents=True, exist_ok=True)
    (folder / label / "label.txt").write_text(label)
    manifest = Manifest.for_directory(
        folder / label,
        self_test=TESTED,
        sensor={"name": "os0-64"},
        counts={"templates": 7},
        bounds=((0.0, 0.0, 0.0), (10.0, 20.0, 3.04)),
    )
    return catalog.publish("hall", folder / label, manifest, **values)


@pytest.fixture
def catalog(tmp_path: Path) -> Catalog:
    return Catalog(Store.open(str(tmp_path / "store")))


def test_a_version_says_what_it_was_made_of(catalog: Catalog, tmp_path: Path):
    version = put(catalog, tmp_path, provenance=MADE)
    again = Catalog(catalog.store)  # nothing in memory
    (info,) = again.versions("hall")
    assert info.provenance == MADE
    assert info.summary == {
        "sensor": "os0-64",
        "size_m": [10.0, 20.0, 3.0],
        "templates": 7,
        "found": 0.99,
        "localized": 0.9,
        "false_accepts": None,
        "threshold": {"min_probability": 0.95, "max_false_accept": 0.005, "bound": 0.0027, "kept_by": "rate"},
    }
    summary = map_summary("hall", again.state("hall"))
    assert summary["summary"]["localized"] == 0.9
    assert map_details(again, "hall")["provenance"]["file_name"] == "hall.laz"
    assert version_details(again, "hall", version)["provenance"]["note"] == "before the move"


def test_who_and_where_are_for_those_who_may_see_them(catalog: Catalog, tmp_path: Path):
    put(catalog, tmp_path, provenance=MADE)
    (info,) = catalog.versions("hall")
    shown = version_summary(info, lambda made: False)["provenance"]
    assert shown["file_name"] == "hall.laz"
    assert not {"caller", "host", "command"} & shown.keys()
    assert (
        version_summary(info, lambda made: made.caller == "key:0123456789ab")["provenance"]["host"] == "pc7"
    )


def test_the_same_map_has_the_same_version_whoever_builds_it(catalog: Catalog, tmp_path: Path):
    first = put(catalog, tmp_path, provenance=MADE)
    assert put(catalog, tmp_path, provenance=Provenance("other.ply", note="again")) == first
    (info,) = catalog.versions("hall")
    assert info.provenance == MADE, "the first publication counts"


def test_it_survives_many_entries_of_the_log(catalog: Catalog, tmp_path: Path):
    first = put(catalog, tmp_path, provenance=MADE)
    second = put(catalog, tmp_path, "2")
    for number in range(ENTRIES_PER_SNAPSHOT):
        catalog.activate("hall", (first, second)[number % 2])
    infos = {info.version: info for info in Catalog(catalog.store).versions("hall")}
    assert infos[first].provenance == MADE
    assert infos[second].provenance == Provenance()


def test_texts_are_one_bounded_line_without_secrets():
    made = Provenance(
        file_name="a\nb\x1b[31m" + "x" * 999, command="curl -H 'Authorization: Bearer abcdefghijkl'"
    )
    assert "\n" not in made.file_name
    assert "\x1b" not in made.file_name
    assert len(made.file_name) <= 300
    assert "abcdefghijkl" not in made.command


def test_what_another_release_recorded_does_no_harm():
    assert Provenance.from_mapping({"file_name": 7, "size_bytes": "big", "later": 1}) == Provenance()


@pytest.mark.parametrize("note", [7, None, "x" * (MAX_NOTE_CHARS + 1)])
def test_a_note_is_a_short_text(note: object):
    with pytest.raises(InvalidOption, match="at most 500 characters"):
        check_note(note)


def test_first_characters_name_a_version(catalog: Catalog, tmp_path: Path):
    version = put(catalog, tmp_path)
    assert catalog.full_version("hall", version[:6]) == version
    assert catalog.full_version("hall", version[:6].upper()) == version
    with pytest.raises(NotFound, match="no map yard"):
        catalog.full_version("yard", version[:6])
    catalog.retire("hall", version, force=True)
    with pytest.raises(NotFound, match="no version begins with"):
        catalog.full_version("hall", version[:6])
