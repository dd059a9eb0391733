"""The presets over HTTP are those of the core, value by value."""

from __future__ import annotations

from service_world import Service

from firstfix.sensor import SensorModel, preset, presets


def test_the_presets_come_with_all_their_values(service: Service):
    found = service.http.get("/sensors").json()
    assert [one["name"] for one in found] == presets()
    assert [SensorModel.from_mapping(one) for one in found] == [preset(name) for name in presets()]
