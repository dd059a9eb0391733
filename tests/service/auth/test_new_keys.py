"""Keys that were made since the service listed them: looked up once, within limits."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from firstfix.access.api_keys import ApiKeys, parse_token
from firstfix.access.permissions import Grant
from firstfix.store.store import Store
from firstfix.wire.signature import Asked, SigningKey
from firstfix_service.auth.key_ring import KeyRing
from firstfix_service.auth.new_keys import NewKeys
from firstfix_service.limits.limits import Limits
from tests.service.access_world import Clock, ask_zenoh, get, give, localize
from tests.service.service_world import SCAN_BODY, XYZ, Service, publish, running_service
from tests.waiting import LIMIT_S

KEY = "firstfix/hall/localize"


@pytest.fixture
def rare(tmp_path: Path) -> Iterator[Service]:
    """A service that lists the keys at its start alone."""
    with running_service(tmp_path, auth="on", keys_refresh_s=3600.0) as running:
        publish(running.catalog, "hall", "1", running.scratch)
        running.wait_until_loaded()
        yield running


def test_a_new_key_works_at_once_on_both_transports(rare: Service):
    assert localize(rare, give(rare, "localize")).status_code == 200
    assert ask_zenoh(rare, give(rare, "localize")).ok
    assert get(rare, "/maps", give(rare, "build")).status_code == 200


def test_a_query_that_is_signed_with_a_new_key_is_answered(rare: Service):
    key = SigningKey.of_api_key(give(rare, "localize"))
    assert key is not None
    signature = key.sign(Asked.of(KEY, [], XYZ), SCAN_BODY, int(time.time() * 1000), os.urandom(16))
    replies: Any = rare.session.get(
        zenoh.Selector(KEY, {}),
        payload=SCAN_BODY,
        encoding=XYZ,
        attachment=signature.to_bytes(),
        timeout=LIMIT_S,
    )
    assert [reply.ok is not None for reply in replies] == [True]


def test_a_revoked_key_and_a_wrong_secret_are_refused(rare: Service):
    keys = ApiKeys(rare.catalog.store)
    revoked = give(rare, "admin")
    keys.revoke(str(parse_token(revoked)[0]))  # type: ignore[index]
    assert get(rare, "/maps", revoked).status_code == 401
    right = give(rare, "admin")
    assert get(rare, "/maps", right[:-1] + ("0" if right[-1] != "0" else "1")).status_code == 401
    assert get(rare, "/maps", right).status_code == 200


def test_a_key_that_was_unknown_a_moment_ago_waits_for_the_listing(tmp_path: Path):
    ring, looked, new = counted(tmp_path)
    token = "ffx_0123456789ab_" + "0" * 64

    async def ask() -> None:
        await asyncio.gather(*(new.look_up("0123456789ab", "10.0.0.1") for _ in range(20)))
        assert looked == ["0123456789ab"], "one look-up, however many ask"
        ApiKeys(Store.open(str(tmp_path))).create("late", Grant.parse(["localize"], ["*"]), None, token)
        await new.look_up("0123456789ab", "10.0.0.2")
        assert looked == ["0123456789ab"]

    asyncio.run(ask())
    ring.refresh()
    assert ring.knows("0123456789ab")


def test_invented_keys_cost_few_look_ups(tmp_path: Path):
    clock = Clock()
    _, looked, new = counted(tmp_path, clock)

    async def flood(address: str, count: int) -> None:
        for _ in range(count):
            await new.look_up(os.urandom(6).hex(), address)

    asyncio.run(flood("10.0.0.1", 200))
    assert len(looked) == Limits.new_keys_burst, "of one address"
    for number in range(50):
        asyncio.run(flood(f"10.0.1.{number}", 20))
    assert len(looked) == Limits.all_new_keys_burst, "of all addresses together"
    clock.advance(1.0)
    for number in range(50):
        asyncio.run(flood(f"10.0.2.{number}", 20))
    assert len(looked) <= Limits.all_new_keys_burst + Limits.all_new_keys_per_s


def counted(folder: Path, clock: Clock | None = None) -> tuple[KeyRing, list[str], NewKeys]:
    """A ring of the keys of a store, the ids that were looked up there, and the look-up."""
    looked: list[str] = []

    class Counted(KeyRing):
        def learn(self, key_id: str) -> None:
            looked.append(key_id)
            super().learn(key_id)

    ring = Counted(ApiKeys(Store.open(str(folder))), 100.0)
    ring.refresh()
    return ring, looked, NewKeys(ring, Limits(), clock or Clock())
