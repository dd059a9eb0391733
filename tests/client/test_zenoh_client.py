"""The zenoh client against real zenoh sessions on loopback, one of which dies."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import zenoh

from firstfix.answer.localization import Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.errors import FirstfixError, InvalidOption, NotFound, Overloaded
from firstfix.scan.compact import CompactScan, ScanDescriptor
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.wire import query as wire_query
from firstfix.wire import scan as wire
from firstfix_client import HedgePolicy, RetryPolicy, ServiceUnreachable, ZenohClient
from tests.client.fake_answers import SCAN, T_MAP_SENSOR, answer_bytes, problem_bytes
from tests.client.zenoh_sessions import opened
from tests.servers import free_port
from tests.waiting import let_pass, wait_until

QUICK = RetryPolicy(attempts=6, first_wait_s=0.01, max_wait_s=0.05)


class Replica:
    """A session with the queryables and the token of a replica."""

    def __init__(
        self, endpoint: str, name: str, answer: Callable[[Any], None], looker: Any, *, token: bool = True
    ) -> None:
        self.queries: list[tuple[str, dict[str, str], str, bytes]] = []
        self._answer = answer
        self.session = opened("client", "connect", endpoint)
        keys = ["firstfix/hall/localize", f"firstfix/hall/localize/{name}"]
        self.queryables = [self.session.declare_queryable(k, self._asked, complete=True) for k in keys]
        self.token = self.session.liveliness().declare_token(keys[1]) if token else None
        self._looker, self._key = looker.declare_querier(keys[1]), keys[1]

    @property
    def is_known(self) -> bool:
        """Returns True once other sessions see its declarations over the router."""
        return bool(self._looker.matching_status.matching)

    def _asked(self, query: Any) -> None:
        parameters, body = dict(iter(query.parameters)), query.payload.to_bytes()
        self.queries.append((str(query.key_expr), parameters, str(query.encoding), body))
        self._answer(query)


def answers(query: Any) -> None:
    query.reply(query.key_expr, answer_bytes(), encoding="application/json")


def is_silent(query: Any) -> None:
    """Ends a query without a reply, like a replica that dies."""


def complains(code: str) -> Callable[[Any], None]:
    return lambda query: query.reply_err(problem_bytes(code), encoding="application/problem+json")


@pytest.fixture
def router() -> Iterator[str]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    session = opened("router", "listen", endpoint)
    yield endpoint
    session.close()


@pytest.fixture
def replica(router) -> Iterator[Callable[..., Replica]]:
    made: list[Replica] = []
    looker = opened("client", "connect", router)

    def make(name: str, answer: Callable[[Any], None] = answers, **how: Any) -> Replica:
        made.append(Replica(router, name, answer, looker, **how))
        wait_until(lambda: made[-1].is_known)
        return made[-1]

    yield make
    for one in made:
        one.session.close()
    looker.close()


@pytest.fixture
def client(router) -> Iterator[ZenohClient]:
    with ZenohClient(router, timeout_s=8.0, retry=QUICK) as connected:
        yield connected


def test_a_fix_is_a_typed_answer(replica, client):
    only = replica("r1")
    answer = client.localize(SCAN, map_id="hall", options=LocalizeOptions(max_candidates=5))
    assert answer.verdict is Verdict.LOCALIZED
    np.testing.assert_allclose(answer.T_map_sensor, T_MAP_SENSOR, atol=1e-12)
    ((key, parameters, encoding, body),) = only.queries
    assert key == "firstfix/hall/localize/r1"
    assert parameters.pop("deadline_ms").isdigit()
    assert parameters == {"max_candidates": "5"}
    assert encoding == wire.MEDIA_TYPE
    assert np.abs(wire.decode_scan(body).points - SCAN.points).max() < 0.0051


def test_zenoh_and_http_clients_send_the_same_bodies(replica, client):
    only = replica("r1")
    parameters = DescriptorParameters(descriptor=LayeredOccupancy(PolarGrid(20, 60, 25.0)))
    client.localize(SCAN, map_id="hall", encoding="compact")
    client.localize(SCAN, map_id="hall", encoding="descriptor", parameters=parameters)
    with pytest.raises(InvalidOption, match="parameters"):
        client.localize(SCAN, map_id="hall", encoding="descriptor")
    assert [encoding for *_, encoding, _ in only.queries] == [wire_query.MEDIA_TYPE] * 2
    sent = [type(wire_query.decode_query(body)) for *_, body in only.queries]
    assert sent == [CompactScan, ScanDescriptor]


def test_the_load_is_spread_over_live_replicas(replica, client):
    replicas = [replica(name) for name in ("r1", "r2")]
    for _ in range(20):
        client.localize(SCAN, map_id="hall")
    assert all(len(one.queries) >= 2 for one in replicas)
    assert sum(len(one.queries) for one in replicas) == 20


def test_without_tokens_the_shared_key_is_asked(replica, client):
    only = replica("r1", token=False)
    assert client.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
    assert only.queries[0][0] == "firstfix/hall/localize"


@pytest.mark.parametrize("trouble", [is_silent, complains("overloaded")])
def test_another_replica_is_asked_when_one_fails(replica, client, trouble):
    bad, good = replica("r1", trouble), replica("r2")
    for _ in range(6):
        assert client.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
    assert good.queries
    assert len(bad.queries) < 12


def test_a_replica_that_leaves_is_not_asked_any_more(replica, client):
    leaving, staying = replica("r1"), replica("r2")
    client.localize(SCAN, map_id="hall")
    leaving.session.close()
    wait_until(lambda: not leaving.is_known)
    leaving.queries.clear()
    for _ in range(8):
        client.localize(SCAN, map_id="hall")
    assert leaving.queries == []
    assert len(staying.queries) >= 8


def test_a_replica_that_hangs_leaves_time_for_another(replica, client):
    held = []
    replica("r1", held.append)  # keeps the query open
    good = replica("r2")
    for _ in range(5):
        assert client.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
    assert good.queries


def test_a_replica_that_is_slow_is_raced(replica, router):
    held = []
    slow = replica("r1", held.append)  # keeps the query open
    good = replica("r2")
    # Without the race it would ask the other one after half of the timeout: the test does not last so long.
    with ZenohClient(router, timeout_s=5000.0, retry=QUICK, hedge=HedgePolicy(after_s=0.1)) as client:
        while not slow.queries:
            assert client.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
    assert good.queries[-1][3] == slow.queries[0][3], "the same query"


@pytest.mark.parametrize("token", [True, False])
def test_a_query_that_got_lost_is_sent_again(replica, client, token):
    held = []

    def loses_the_first(query: Any) -> None:
        if held:
            answers(query)
        else:
            held.append(query)  # keeps it open

    only = replica("r1", loses_the_first, token=token)
    assert client.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
    assert len(only.queries) == 2


def test_a_slow_replica_is_waited_for_when_the_other_fails(replica, router):
    def late(query: Any) -> None:
        let_pass(0.5)
        answers(query)

    slow, busy = replica("r1", late), replica("r2", complains("overloaded"))
    with ZenohClient(router, timeout_s=20.0, retry=QUICK, hedge=HedgePolicy(after_s=0.05)) as client:
        for _ in range(4):
            assert client.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
    assert slow.queries
    assert busy.queries


def test_a_replica_that_comes_late_is_found(replica, client):
    threading.Timer(0.3, lambda: replica("r1")).start()
    client._retry = RetryPolicy()
    assert client.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED


def replies_nonsense(query: Any) -> None:
    query.reply(query.key_expr, b"<html>")


@pytest.mark.parametrize(
    ("answer", "error", "says"),
    [
        (complains("not_found"), NotFound, "because"),
        (complains("invalid_option"), InvalidOption, "because"),
        (complains("overloaded"), Overloaded, "because"),
        (replies_nonsense, FirstfixError, "this client cannot read"),
    ],
)
def test_a_problem_is_its_error(replica, client, answer, error, says):
    only = replica("r1", answer)
    with pytest.raises(error, match=says):
        client.localize(SCAN, map_id="hall")
    assert len(only.queries) == 1 or error is Overloaded, "it is final"


def test_an_unreachable_service_is_named(client):
    with pytest.raises(ServiceUnreachable, match="firstfix/hall/localize"):
        client.localize(SCAN, map_id="hall")


def test_a_map_id_with_wildcards_is_refused(client):
    with pytest.raises(InvalidOption):
        client.localize(SCAN, map_id="**")


def test_an_unreachable_router_is_named():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with pytest.raises(ServiceUnreachable, match=endpoint):
        ZenohClient(endpoint, timeout_s=0.5)


def test_a_config_file_is_read(router, replica, tmp_path):
    replica("r1")
    config = tmp_path / "zenoh.json5"
    told = {
        "mode": "client",
        "connect": {"endpoints": [router]},
        "scouting": {"multicast": {"enabled": False}},
    }
    config.write_text(json.dumps(told))
    with ZenohClient(config=config) as client:
        assert client.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
    config.write_text("{nonsense")
    with pytest.raises(InvalidOption):
        ZenohClient(config=config)


def test_a_missing_zenoh_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "zenoh", None)
    with pytest.raises(ModuleNotFoundError, match=r"clients/python\[zenoh\]"):
        ZenohClient("tcp/localhost:7447")


def test_a_config_in_place_of_a_path_is_refused_without_its_content():
    config = zenoh.Config()
    config.insert_json5("transport/auth/usrpwd", '{"user": "robot", "password": "secret-word"}')
    with pytest.raises(InvalidOption, match="path of a file") as refused:
        ZenohClient(config=config)
    assert "secret-word" not in str(refused.value)
