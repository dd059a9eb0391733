"""The map that a misspelt name most resembles."""

from __future__ import annotations

import pytest

from firstfix.catalog.nearest_map import with_nearest
from firstfix.errors import NotFound


@pytest.mark.parametrize(
    ("asked", "meant"),
    [("hal-2", "hall-2"), ("hall2", "hall-2"), ("yrad", "yard"), ("warehouse", ""), ("x", "")],
)
def test_a_misspelt_map_is_told_its_name(asked: str, meant: str):
    found = with_nearest(NotFound.of_map(asked), lambda: ["hall-2", "yard"])
    assert (found.map_id, found.nearest) == (asked, meant)
    assert str(found) == f"no map {asked}" + (f": did you mean {meant}?" if meant else "")


def test_the_names_of_maps_are_read_only_where_a_map_is_not_there():
    def names() -> list[str]:
        raise AssertionError("nobody needs them")

    error = NotFound("no build 7")
    assert with_nearest(error, names) is error


def test_an_answer_does_not_wait_for_thousands_of_names():
    error = NotFound.of_map("hal")
    assert with_nearest(error, lambda: ["hall", *map(str, range(5000))]) is error
