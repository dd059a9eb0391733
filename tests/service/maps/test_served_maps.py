"""State of the served maps, kept without asking the store."""

from __future__ import annotations

import pytest

from firstfix_service.maps.served_maps import ServedMaps
from firstfix_service.telemetry.metrics import Metrics


@pytest.fixture
def maps() -> ServedMaps:
    return ServedMaps(None, None, Metrics())  # type: ignore[arg-type]


def test_published_maps_and_serving_versions(maps: ServedMaps) -> None:
    maps.add({"b", "a"})
    assert maps.serve("c", "v1", is_active=True) is None
    assert maps.serve("c", "v2", is_active=True) == "v1"
    assert maps.ids == ["a", "b", "c"]
    assert len(maps) == 3
    assert "b" in maps
    assert "d" not in maps
    assert maps.versions == {"c": "v2"}
    assert maps.version("c") == "v2"
    assert maps.version("a") is None


def test_a_map_is_behind_until_its_active_version_answers(maps: ServedMaps) -> None:
    maps.serve("a", "old", is_active=False)
    assert maps.is_behind("a")
    maps.serve("a", "new", is_active=True)
    assert not maps.is_behind("a")
    maps.serve("a", "old", is_active=False)
    maps.forget("a")
    assert not maps.is_behind("a")
    assert "a" not in maps
    assert maps.version("a") is None


def test_touched_maps_are_returned_once(maps: ServedMaps) -> None:
    maps.add({"a", "b"})
    maps.serve("c", "v1", is_active=True)
    maps.forget("a")
    maps.touch(["d"])
    assert maps.take_touched() == {"a", "b", "c", "d"}
    assert maps.take_touched() == set()
