"""A map that is not there: over HTTP its problem names the one that was meant, if the caller may know it."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Grant
from firstfix.store.store import Store
from tests.service.access_world import bearer
from tests.service.service_world import Service, served, serving

POINTS = b"0 0 0\n1 0 0\n"


@serving(zenoh=False)
@pytest.mark.parametrize("path", ["/maps/hal", "/maps/hal/versions", "/localize?map=hal"])
def test_the_nearest_map_is_named(service: Service, path: str):
    service.wait_until_loaded()
    method = "POST" if path.startswith("/localize") else "GET"
    answer = service.http.request(method, path, content=POINTS, headers={"Content-Type": "text/plain"})
    told = answer.json()
    assert (answer.status_code, told["code"], told["nearest"]) == (404, "not_found", "hall")
    assert told["detail"] == "no map hal: did you mean hall?"


@serving(zenoh=False)
def test_nothing_is_named_that_is_another_thing(service: Service):
    service.wait_until_loaded()
    assert "nearest" not in service.http.get("/maps/warehouse").json()
    assert "nearest" not in service.http.get("/builds/hal").json()


def test_a_map_that_the_caller_may_not_see_is_not_named(tmp_path: Path):
    keys = ApiKeys(Store.open(str(tmp_path / "store")))
    hidden, open_to = (
        keys.create(name, Grant.parse(["localize"], maps))[1]
        for name, maps in (("hidden", ["hal"]), ("open", ["hal*"]))
    )
    with served(tmp_path, auth="on", zenoh=False) as service:
        service.wait_until_loaded()
        for key, nearest in ((hidden, None), (open_to, "hall")):
            told = service.http.get("/maps/hal", headers=bearer(key)).json()
            assert (told["code"], told.get("nearest")) == ("not_found", nearest)
