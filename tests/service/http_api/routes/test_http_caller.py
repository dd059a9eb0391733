"""A caller is told what it may do, and the presets of sensors are those of the core."""

from __future__ import annotations

from firstfix.sensor import SensorModel, preset, presets
from tests.service.service_world import Service


def test_without_authentication_everybody_may_do_everything(service: Service):
    found = service.http.get("/caller").json()
    assert found["name"].startswith("address:")
    assert found["scopes"] == ["localize", "build", "metrics", "admin"]
    assert (found["maps"], found["authentication"], found["read_only"]) == (["*"], False, False)


def test_the_presets_come_with_all_their_values(service: Service):
    found = service.http.get("/sensors").json()
    assert [one["name"] for one in found] == presets()
    assert [SensorModel.from_mapping(one) for one in found] == [preset(name) for name in presets()]
