"""Keys over HTTP: made, listed without secrets, revoked; by administrators of all maps alone."""

from __future__ import annotations

from typing import Any

import httpx
import pytest

from tests.service.access_world import bearer, known
from tests.service.service_world import Service
from tests.waiting import wait_until

NEW = {"name": "robot-7", "scopes": ["localize"], "maps": ["hall*"], "expires_in_days": 90}


def status_of(service: Service, token: str) -> int:
    return service.http.get("/caller", headers=bearer(token)).status_code


@pytest.fixture
def admin(closed: Service) -> dict[str, str]:
    return bearer(known(closed, "admin"))


def test_a_key_is_made_used_and_revoked(closed: Service, admin: dict[str, str]):
    made = closed.http.post("/keys", json=NEW, headers=admin)
    assert made.status_code == 201
    token = made.json()["token"]
    wait_until(lambda: status_of(closed, token) == 200)
    assert closed.http.get("/caller", headers=bearer(token)).json()["maps"] == ["hall*"]
    listed = closed.http.get("/keys", headers=admin)
    assert token not in listed.text
    assert "sha256" not in listed.text
    (mine,) = (key for key in listed.json()["keys"] if key["name"] == "robot-7")
    assert (mine["scopes"], mine["revoked"]) == (["localize"], False)
    assert mine["expires_time"] is not None
    assert closed.http.delete(f"/keys/{mine['key_id']}", headers=admin).status_code == 204
    wait_until(lambda: status_of(closed, token) == 401)
    assert closed.http.delete("/keys/0123456789ab", headers=admin).status_code == 404


@pytest.mark.parametrize(
    "wrong",
    [
        {"name": ""},
        {"name": "a\nb"},
        {"scopes": []},
        {"scopes": ["everything"]},
        {"maps": []},
        {"maps": ["Hall"]},
        {"expires_in_days": 0},
        {"expires_in_days": 1e9},
        {"more": 1},
    ],
)
def test_an_invalid_key_is_refused(closed: Service, admin: dict[str, str], wrong: dict[str, Any]):
    before = len(closed.http.get("/keys", headers=admin).json()["keys"])
    assert closed.http.post("/keys", json={**NEW, **wrong}, headers=admin).status_code == 400
    assert len(closed.http.get("/keys", headers=admin).json()["keys"]) == before


def test_only_an_administrator_of_all_maps_manages_keys(closed: Service):
    """One of some maps could else make a key that opens the others."""

    def answers(token: str) -> list[httpx.Response]:
        return [
            closed.http.get("/keys", headers=bearer(token)),
            closed.http.post(
                "/keys", json={**NEW, "scopes": ["admin"], "maps": ["*"]}, headers=bearer(token)
            ),
            closed.http.delete("/keys/0123456789ab", headers=bearer(token)),
        ]

    for token in (known(closed, "build"), known(closed, "admin", maps=("hall",))):
        assert {answer.status_code for answer in answers(token)} == {403}
