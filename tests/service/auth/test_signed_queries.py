"""Signed queries: accepted once, in time, by a key that is valid."""

from __future__ import annotations

from contextlib import suppress

import pytest

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Grant
from firstfix.errors import ClockSkew, RateLimited, StoreUnavailable, Unauthorized
from firstfix.store.store import Store
from firstfix.wire.signature import WINDOW_S, Asked, SigningKey
from firstfix_service.auth import signed_queries
from firstfix_service.auth.key_ring import KeyRing
from firstfix_service.auth.signed_queries import REMEMBERED_S, SignedQueries

ASKED = Asked.of("firstfix/hall/localize", [], "a/b")
NOW_MS = 1_700_000_000_000


class World:
    def __init__(self) -> None:
        self.keys = ApiKeys(Store.open("memory://"))
        self.ring_s, self.now_s = 0.0, NOW_MS / 1000
        self.ring = KeyRing(self.keys, 100.0, lambda: self.ring_s)
        self.ahead_s = 0.0  # of the service's wall clock; the robots' are right
        self.start()
        self.now_s += 1000.0
        self.key = self.made_key()
        self._nonce = 0

    def start(self) -> None:
        self.queries = SignedQueries(self.ring, lambda: self.now_s + self.ahead_s, lambda: self.now_s)

    def made_key(self) -> SigningKey:
        made = SigningKey.of_api_key(self.keys.create("a", Grant.parse(["localize"], ["*"]))[1])
        assert made is not None
        self.ring.refresh()
        return made

    def signed(self, late_s: float = 0.0, nonce: bytes | None = None, key: SigningKey | None = None) -> bytes:
        self._nonce += 1
        time_ms = round((self.now_s - late_s) * 1000)
        return (
            (key or self.key).sign(ASKED, b"", time_ms, nonce or self._nonce.to_bytes(16, "big")).to_bytes()
        )

    def ask(self, attachment: bytes) -> bool:
        return self.queries.accept(self.queries.check(attachment, ASKED))


@pytest.fixture
def world() -> World:
    return World()


def test_the_caller_is_the_key(world: World):
    found = world.queries.check(world.signed(), ASKED)
    assert found.principal.name == f"key:{world.key.key_id}"
    world.queries.accept(found)


def test_a_query_is_accepted_once(world: World):
    attachment = world.signed()
    assert world.ask(attachment)
    assert not world.ask(attachment)
    assert world.ask(world.signed())


@pytest.mark.parametrize("late_s", [-WINDOW_S, 0, WINDOW_S])
def test_a_clock_may_be_a_little_wrong(world: World, late_s: float):
    world.ask(world.signed(late_s))


@pytest.mark.parametrize("late_s", [-1e6, -WINDOW_S - 0.01, WINDOW_S + 0.01, 1e6])
def test_a_wrong_clock_gets_the_time(world: World, late_s: float):
    with pytest.raises(ClockSkew) as caught:
        world.ask(world.signed(late_s))
    assert caught.value.time_ms == int(world.now_s * 1000)


@pytest.mark.parametrize("late_s", [-WINDOW_S, 0, WINDOW_S])
def test_a_query_is_remembered_as_long_as_it_is_in_time(world: World, late_s: float):
    attachment = world.signed(late_s)
    world.ask(attachment)
    for _ in range(int(2 * REMEMBERED_S)):
        world.now_s += 1
        with suppress(ClockSkew):
            assert not world.ask(attachment)
    assert world.ask(world.signed())
    assert len(world.queries._seen) == 1, "what is out of time is forgotten"
    assert sum(world.queries._of_key.values()) == 1


def test_a_query_from_before_the_start_is_refused(world: World):
    """A service that starts anew does not know which queries it has answered."""
    attachment = world.signed()
    world.ask(attachment)
    world.now_s += 1.0
    world.start()
    with pytest.raises(ClockSkew):
        world.ask(attachment)


def test_a_clock_that_is_set_back_after_the_start_serves_at_once(world: World):
    world.ahead_s = 3600.0
    world.start()
    world.now_s += 5.0
    with pytest.raises(ClockSkew):
        world.ask(world.signed())
    assert world.ask(world.signed(-3600.0)), "a robot that follows the service's clock"
    world.ahead_s = 0.0
    with pytest.raises(ClockSkew):
        world.ask(world.signed(3.0))
    world.now_s += 1.0
    assert world.ask(world.signed())


def test_a_clock_that_is_set_forward_after_the_start_serves_at_once(world: World):
    world.ahead_s = -3600.0
    world.start()
    world.now_s += 5.0
    with pytest.raises(ClockSkew):
        world.ask(world.signed())
    assert world.ask(world.signed(3600.0)), "a robot that follows the service's clock"
    world.ahead_s = 0.0
    assert world.ask(world.signed(3.0))


def test_a_query_from_before_the_start_is_refused_after_the_clock_is_set_right(world: World):
    before = world.signed()
    world.ask(before)
    world.now_s += 1.0
    world.ahead_s = -3600.0
    world.start()
    world.now_s += 5.0
    world.ahead_s = 0.0
    with pytest.raises(ClockSkew):
        world.ask(before)
    assert world.ask(world.signed())


def test_an_old_query_stays_refused_after_the_clock_is_set_back(world: World):
    """It was accepted and forgotten: a copy of it must not be accepted again."""
    attachment = world.signed()
    world.ask(attachment)
    world.now_s += 3 * REMEMBERED_S
    world.ask(world.signed())
    world.ahead_s = 30.0 - 3 * REMEMBERED_S  # by the service's clock the first query is half a minute old
    with pytest.raises(ClockSkew) as caught:
        world.ask(attachment)
    world.now_s += 1.0
    late_s = world.now_s - caught.value.time_ms / 1000 - 1.0  # the robot follows the service's clock
    assert world.ask(world.signed(late_s))


def test_nonces_are_forgotten_in_time_after_the_clock_is_set_back(
    world: World, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(signed_queries, "MAX_NONCES_PER_KEY", 5)
    for _ in range(5):
        world.ask(world.signed())
    world.ahead_s = -3600.0
    world.now_s += REMEMBERED_S + 1.0
    with pytest.raises(ClockSkew):
        world.ask(world.signed(3601.0))
    world.now_s += 1.0
    assert world.ask(world.signed(3600.0))


def test_one_key_cannot_fill_the_memory_of_another(world: World, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(signed_queries, "MAX_NONCES_PER_KEY", 5)
    for _ in range(5):
        world.ask(world.signed())
    with pytest.raises(RateLimited):
        world.ask(world.signed())
    other = world.made_key()
    world.ask(world.signed(key=other))
    world.now_s += REMEMBERED_S + 1
    world.ask(world.signed())


def test_invalid_signatures_take_no_memory(world: World):
    stranger = SigningKey.of_api_key(f"ffx_{world.key.key_id}_{'0' * 64}")
    unknown = SigningKey.of_api_key(f"ffx_{'0' * 12}_{'0' * 64}")
    for attachment in (b"", b"FFQ1", b"x" * 104, *(world.signed(key=key) for key in (stranger, unknown))):
        with pytest.raises(Unauthorized):
            world.ask(attachment)
    assert not world.queries._seen


def test_a_revoked_key_signs_no_more(world: World):
    world.ask(world.signed())
    world.keys.revoke(world.key.key_id)
    world.ring.refresh()
    with pytest.raises(Unauthorized, match="revoked"):
        world.ask(world.signed())


def test_keys_that_were_not_read_for_long_are_refused(world: World):
    world.ring_s += 101.0
    with pytest.raises(StoreUnavailable):
        world.ask(world.signed())
