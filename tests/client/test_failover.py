"""Failover and hedging over several URLs, and calls that are never sent twice, for both HTTP clients."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from starlette.responses import Response

from firstfix.answer.localization import Verdict
from firstfix.errors import DeadlineExceeded, NotFound, Overloaded, RateLimited
from firstfix_client import Client, HedgePolicy, RetryPolicy, ServiceUnreachable
from tests.blocked_async_client import BlockedAsyncClient
from tests.client.answer_server import AnswerServer, ok, problem, raw_server
from tests.client.fake_answers import REJECTED, SCAN, answer_bytes
from tests.servers import free_port
from tests.waiting import LIMIT_S, let_pass, wait_until, wait_until_async

QUICK = RetryPolicy(attempts=6, first_wait_s=0.01, max_wait_s=0.05)
SOON = HedgePolicy(after_s=0.1)
Make = Callable[..., Any]


@pytest.fixture(params=[Client, BlockedAsyncClient])
def client(request: pytest.FixtureRequest) -> Iterator[Make]:
    made: list[Any] = []

    def make(urls: list[str], **how: Any) -> Any:
        """Makes a client that asks the URLs in this order."""
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("random.shuffle", lambda addresses: None)
            made.append(request.param(urls, **{"retry": QUICK, **how}))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.fixture
def servers() -> Iterator[tuple[AnswerServer, AnswerServer]]:
    first, second = AnswerServer(), AnswerServer()
    first.answers = second.answers = [ok(answer_bytes())]
    yield first, second
    first.stop()
    second.stop()


@pytest.fixture
def nobody() -> str:
    return f"http://127.0.0.1:{free_port()}"


class Silent:
    """Takes requests without answering. Reports when a caller closes its connection."""

    def __init__(self) -> None:
        self.url = ""
        self.asked, self.left = threading.Event(), threading.Event()

    def hold(self, connection: socket.socket) -> None:
        while connection.recv(65_536):
            self.asked.set()
        self.left.set()


@pytest.fixture
def silent() -> Iterator[Silent]:
    one = Silent()
    with raw_server(one.hold) as one.url:
        yield one


def test_an_unreachable_address_is_passed_over(client: Make, servers, nobody: str):
    asking = client([nobody, servers[0].url], retry=RetryPolicy(attempts=2, first_wait_s=30, max_wait_s=30))
    assert asking.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED


@pytest.mark.parametrize("code", ["overloaded", "store_unavailable", "read_only"])
def test_a_busy_address_is_passed_over_without_a_wait(client: Make, servers, code: str):
    busy, free = servers
    busy.answers = [problem(code, 503, **{"Retry-After": "30"})]
    asking = client([busy.url, free.url], hedge=False)
    for _ in range(3):
        assert asking.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
    assert len(busy.requests) == 1, "the one that works is kept"
    assert len(free.requests) == 3


def test_a_rate_limit_is_not_dodged(client: Make, servers):
    strict, other = servers
    strict.answers = [problem("rate_limited", 429, **{"Retry-After": "3000"})]
    with pytest.raises(RateLimited):
        client([strict.url, other.url], timeout_s=100).localize(SCAN, map_id="hall")
    assert other.requests == []


def test_an_answer_of_any_verdict_is_final(client: Make, servers):
    first, second = servers
    first.answers = [ok(answer_bytes(REJECTED)), problem("not_found", 404)]
    asking = client([first.url, second.url])
    assert asking.localize(SCAN, map_id="hall").verdict is Verdict.REJECTED
    with pytest.raises(NotFound):
        asking.localize(SCAN, map_id="hall")
    assert second.requests == []


def test_all_addresses_are_asked_before_it_gives_up(client: Make, servers, nobody: str):
    for one in servers:
        one.answers = [problem("overloaded", 503)]
    with pytest.raises(Overloaded):
        client([one.url for one in servers]).maps()
    assert [len(one.requests) for one in servers] == [3, 3]
    with pytest.raises(ServiceUnreachable):
        client([nobody]).maps()


def test_a_slow_address_is_raced_and_cancelled(client: Make, servers, silent: Silent):
    asking = client([silent.url, servers[0].url], hedge=SOON, timeout_s=50.0)
    assert asking.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
    assert silent.asked.is_set()
    assert silent.left.wait(LIMIT_S), "the query that lost is cancelled"
    (request,) = servers[0].requests
    assert int(request[2]["deadline_ms"]) <= 49_900, "the second is told what is left"


def test_the_connection_of_the_winner_is_kept(client: Make, servers):
    first, second = servers
    asking = client([first.url, second.url], hedge=HedgePolicy(after_s=100))
    ports = first.ports
    for _ in range(4):
        asking.localize(SCAN, map_id="hall")
    assert len(ports) == 4
    assert len(set(ports)) == 1
    assert second.requests == []


def test_a_slow_answer_wins_over_a_quick_failure(client: Make, servers):
    slow, busy = servers

    def late() -> Response:
        wait_until(lambda: busy.requests)
        let_pass(0.2)  # the failure is there before it
        return ok(answer_bytes())

    slow.answers, busy.answers = [late], [problem("overloaded", 503)]
    assert client([slow.url, busy.url], hedge=SOON).localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
    assert (len(slow.requests), len(busy.requests)) == (1, 1)


def test_one_address_is_hedged_only_if_wished(client: Make, servers):
    one, _ = servers

    def raced() -> Response:
        wait_until(lambda: len(one.requests) == 2)
        return ok(answer_bytes())

    def late() -> Response:
        let_pass(0.6)
        return ok(answer_bytes())

    one.answers = [raced, ok(answer_bytes()), late, ok(answer_bytes())]
    client([one.url], hedge=SOON).localize(SCAN, map_id="hall")
    assert len(one.requests) == 2
    client([one.url]).localize(SCAN, map_id="hall")
    assert len(one.requests) == 3


def test_two_hanging_addresses_end_at_the_deadline(client: Make, silent: Silent):
    other = Silent()
    with raw_server(other.hold) as other.url:
        with pytest.raises(DeadlineExceeded):
            client([silent.url, other.url], hedge=SOON, timeout_s=3).localize(SCAN, map_id="hall")
        assert silent.left.wait(LIMIT_S)
        assert other.left.wait(LIMIT_S)


@pytest.mark.parametrize("hedge", [False, SOON])
def test_an_answer_that_trickles_ends_at_the_deadline(client: Make, hedge: Any):
    """Sends bytes one by one, so slowly that the whole answer is late."""
    stopped = threading.Event()

    def trickle(connection: socket.socket) -> None:
        connection.recv(65_536)
        connection.sendall(b"HTTP/1.1 200 OK\r\ncontent-length: 1000\r\n\r\n")
        while not stopped.wait(0.05):
            connection.sendall(b" ")

    with raw_server(trickle) as url, pytest.raises(DeadlineExceeded):
        client([url], hedge=hedge, timeout_s=0.5).localize(SCAN, map_id="hall")
    stopped.set()


def test_without_hedging_one_that_hangs_leaves_time(client: Make, servers, silent: Silent):
    asking = client([silent.url, servers[0].url], hedge=False, timeout_s=6.0)
    assert asking.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED


def test_an_unrepeatable_call_is_sent_once(client: Make, servers):
    with raw_server(lambda connection: connection.recv(65_536)) as url, pytest.raises(ServiceUnreachable):
        client([url, servers[0].url]).roll_back("hall")
    assert servers[0].requests == []


def test_a_cancelled_query_hangs_up(silent: Silent):
    import asyncio

    from firstfix_client import AsyncClient

    async def ask() -> None:
        async with AsyncClient(silent.url, hedge=SOON) as asking:
            query = asyncio.create_task(asking.localize(SCAN, map_id="hall"))
            await wait_until_async(silent.asked.is_set)
            query.cancel()
            with pytest.raises(asyncio.CancelledError):
                await query

    asyncio.run(ask())
    assert silent.left.wait(LIMIT_S)


def test_addresses_are_read_from_one_text(client: Make, servers, nobody: str):
    asking = client(f"{nobody}, {servers[0].url}/")
    assert asking.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
