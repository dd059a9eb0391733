"""The shipped proxy before replicas that die: every query is answered, and by a replica that lives."""

from __future__ import annotations

import http.client
import re
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest

from firstfix_service.limits.limits import Limits
from tests.deploy.balancer import SHIPPED, Balancer, balancer
from tests.servers import free_port, program
from tests.waiting import LIMIT_S, wait_until

pytestmark = pytest.mark.slow

REPLICA = Path(__file__).with_name("stand_in_replica.py")
BODY = bytes(200_000)
REPLICAS = 3


class Replicas:
    """Stand-in replicas; each may keep a query without an answer."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self.ports = [free_port() for _ in range(REPLICAS)]
        self._processes: dict[int, subprocess.Popen[bytes]] = {}

    def start(self, number: int) -> None:
        command = [sys.executable, "-S", "-E", str(REPLICA), str(self.ports[number]), str(self._directory)]
        self._processes[number] = subprocess.Popen(command)

    def kill(self, number: int) -> None:
        process = self._processes.pop(number)
        process.kill()
        process.wait()

    def kill_all(self) -> None:
        for number in list(self._processes):
            self.kill(number)

    def keep_next_query(self) -> None:
        """The replica that gets the next query does not answer it."""
        (self._directory / "keep").touch()

    def keepers(self) -> list[int]:
        """Returns the numbers of the replicas that keep a query."""
        kept = {int(path.stem) for path in self._directory.glob("*.kept")}
        return [number for number in self._processes if self.ports[number] in kept]

    def release(self) -> None:
        """Lets replicas answer the queries that they keep."""
        for path in self._directory.glob("*.kept"):
            path.unlink()


class Caller:
    """A caller that keeps its connection open and repeats nothing."""

    def __init__(self, proxy: Balancer) -> None:
        host = proxy.url.removeprefix("http://")
        self._connection = http.client.HTTPConnection(host, timeout=LIMIT_S)

    def ask(self) -> int:
        self._connection.request("POST", "/localize?map=hall", BODY)
        answer = self._connection.getresponse()
        answer.read()
        return answer.status


@contextmanager
def proxied(directory: Path) -> Iterator[tuple[Replicas, Balancer]]:
    program("haproxy", "make all-test-servers installs it, for root")
    replicas = Replicas(directory)
    try:
        for number in range(REPLICAS):
            replicas.start(number)
        with balancer(replicas.ports, directory) as proxy:
            wait_until(lambda: all(_listens(port) for port in replicas.ports))
            proxy.wait_until_all_up()
            yield replicas, proxy
    finally:
        replicas.kill_all()


def _listens(port: int) -> bool:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=LIMIT_S)
    try:
        connection.request("GET", "/readyz")
        return connection.getresponse().status == 200
    except OSError:
        return False
    finally:
        connection.close()


def test_a_query_that_a_dying_replica_holds_is_asked_again(tmp_path: Path):
    with proxied(tmp_path) as (replicas, proxy), ThreadPoolExecutor(8) as threads:
        callers = [Caller(proxy) for _ in range(8)]
        assert {caller.ask() for caller in callers} == {200}  # so the next is not the first of its connection
        for _ in range(4):
            replicas.keep_next_query()
            kept = threads.submit(callers[0].ask)
            wait_until(lambda: len(replicas.keepers()) == 1)
            (keeper,) = replicas.keepers()
            others = [
                threads.submit(lambda its=caller: [its.ask() for _ in range(20)]) for caller in callers[1:]
            ]
            replicas.kill(keeper)
            assert kept.result(LIMIT_S) == 200
            assert {status for other in others for status in other.result(LIMIT_S)} == {200}
            replicas.release()
            replicas.start(keeper)
            wait_until(lambda number=keeper: _listens(replicas.ports[number]))
            proxy.wait_until_all_up()


def test_a_dead_replica_is_bypassed_while_the_others_are_busy(tmp_path: Path):
    with proxied(tmp_path) as (replicas, proxy), ThreadPoolExecutor(8) as threads:
        busy = []
        for number in range(1, REPLICAS):  # each keeps one: now bounded load prefers the third
            replicas.keep_next_query()
            busy.append(threads.submit(Caller(proxy).ask))
            wait_until(lambda wanted=number: len(replicas.keepers()) == wanted)
        (idle,) = set(range(REPLICAS)) - set(replicas.keepers())
        replicas.kill(idle)
        assert [Caller(proxy).ask() for _ in range(3)] == [200] * 3
        replicas.release()
        assert [one.result(LIMIT_S) for one in busy] == [200] * 2


def test_a_query_goes_on_when_its_replica_is_not_ready_any_more(tmp_path: Path):
    """So it is with a replica that drains, and with one whose store is away."""
    with proxied(tmp_path) as (replicas, proxy), ThreadPoolExecutor(1) as threads:
        caller = Caller(proxy)
        assert caller.ask() == 200
        replicas.keep_next_query()
        kept = threads.submit(caller.ask)
        wait_until(lambda: len(replicas.keepers()) == 1)
        (tmp_path / f"{replicas.ports[replicas.keepers()[0]]}.not_ready").touch()
        wait_until(lambda: proxy.number_up() == REPLICAS - 1)
        replicas.release()
        assert kept.result(LIMIT_S) == 200


def test_the_proxy_waits_for_a_body_as_long_as_a_replica():
    # The proxy reads all of a query first, and its time for a head would end the slow ones.
    queries = SHIPPED.read_text().partition("\nbackend queries\n")[2].partition("\nbackend ")[0]
    (allowed_s,) = re.findall(r"(?m)^  timeout http-request (\d+)s$", queries)
    assert int(allowed_s) > Limits.body_timeout_s + Limits.linger_s
