"""A caller is told what it may do."""

from __future__ import annotations

from service_world import Service


def test_without_authentication_everybody_may_do_everything(service: Service):
    found = service.http.get("/caller").json()
    assert found["name"].startswith("address:")
    assert found["scopes"] == ["localize", "build", "metrics", "admin"]
    assert (found["maps"], found["authentication"], found["read_only"]) == (["*"], False, False)
