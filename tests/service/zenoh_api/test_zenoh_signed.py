"""Signed queries to a real service whose zenoh strangers can reach."""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from firstfix.access.api_keys import ApiKeys
from firstfix.answer.localization import Verdict
from firstfix.errors import Forbidden, InvalidOption, NotFound, RateLimited, Unauthorized
from firstfix.wire.signature import Asked, QuerySignature, SigningKey
from firstfix_client import RetryPolicy, ServiceUnreachable, ZenohClient
from firstfix_client.drivers import zenoh_ask
from tests.service.access_world import give
from tests.service.service_world import (
    SCAN_BODY,
    XYZ,
    Service,
    client_session,
    free_port,
    publish,
    running_service,
)
from tests.waiting import LIMIT_S, wait_until

SCAN = np.ones((50, 3), np.float32)
KEY = "firstfix/hall/localize"


@dataclass(frozen=True)
class Answer:
    ok: bool
    code: str
    is_signed: bool


@dataclass
class Robot:
    """A robot that signs by hand."""

    service: Service
    api_key: str

    @property
    def key(self) -> SigningKey:
        found = SigningKey.of_api_key(self.api_key)
        assert found is not None
        return found

    def sign(self, key: str = KEY, body: bytes = SCAN_BODY, late_s: float = 0.0, **parameters: str) -> bytes:
        time_ms = int((time.time() - late_s) * 1000)
        asked = Asked.of(key, parameters.items(), XYZ)
        return self.key.sign(asked, body, time_ms, os.urandom(16)).to_bytes()

    def send(
        self,
        attachment: Any,
        key: str = KEY,
        body: bytes = SCAN_BODY,
        media_type: str = XYZ,
        **parameters: str,
    ) -> Answer:
        (reply,) = self.service.session.get(
            zenoh.Selector(key, parameters),
            payload=body,
            encoding=media_type,
            attachment=attachment,
            timeout=LIMIT_S,
        )
        sample = reply.ok or reply.err
        content = sample.payload.to_bytes()
        query = QuerySignature.parse(attachment) if isinstance(attachment, bytes) else None
        is_signed = query is not None and self.key.has_replied(
            query, reply.ok is not None, str(sample.encoding), content
        )
        return Answer(reply.ok is not None, json.loads(content).get("code", ""), is_signed)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    port = free_port()
    with running_service(
        tmp_path_factory.mktemp("open"),
        auth="on",
        zenoh_listen=(f"tcp/127.0.0.1:{port}", f"tcp/0.0.0.0:{free_port()}"),
        keys_refresh_s=0.1,
    ) as running:
        publish(running.catalog, "hall", "1", running.scratch)
        publish(running.catalog, "yard", "2", running.scratch)
        yield running


@pytest.fixture
def robot(service: Service) -> Robot:
    made = Robot(service, give(service, "localize"))
    wait_until(lambda: made.send(made.sign()).ok)  # the service has read the key
    return made


def client(service: Service, api_key: str | None, **more: Any) -> ZenohClient:
    return ZenohClient(service.endpoint, api_key=api_key, **{"timeout_s": 30.0, **more})


def test_a_signed_query_gets_a_signed_answer(robot: Robot):
    for key in (KEY, f"{KEY}/r1"):
        assert robot.send(robot.sign(key), key) == Answer(True, "", True)
    several = "firstfix/@any/localize"
    assert robot.send(robot.sign(several, map="hall"), several, map="hall") == Answer(True, "", True)


def test_an_error_is_signed(robot: Robot):
    assert robot.send(robot.sign("firstfix/attic/localize"), "firstfix/attic/localize") == Answer(
        False, "not_found", True
    )
    assert robot.send(robot.sign(nonsense="ä"), nonsense="ä") == Answer(False, "invalid_option", True)


@pytest.mark.parametrize("wildcard", ["firstfix/*/localize/r1", "firstfix/hall/*"])
def test_signed_wildcards_are_answered(robot: Robot, wildcard: str):
    assert robot.send(robot.sign(wildcard), wildcard).is_signed
    assert not robot.send(robot.sign(KEY), wildcard).ok


def test_altered_queries_are_refused(robot: Robot):
    other = SCAN_BODY[:-12]
    for answer in (
        robot.send(robot.sign(), "firstfix/yard/localize"),
        robot.send(robot.sign(), f"{KEY}/r1"),
        robot.send(robot.sign(), min_probability="0"),
        robot.send(robot.sign(), media_type="application/vnd.firstfix.xyzi"),
        robot.send(bytes(104)),
        robot.send(b"FFQ1"),
        robot.send(b"FFQ9" + robot.sign()[4:]),
    ):
        assert answer == Answer(False, "unauthorized", False)
    assert robot.send(robot.sign(), body=other) == Answer(False, "unauthorized", True)
    large = bytes(1_200_000)
    assert robot.send(robot.sign(body=large), body=large).is_signed
    assert robot.send(robot.sign(body=large), body=large[:-12]).code == "unauthorized"


def test_a_query_is_answered_once(robot: Robot):
    attachment = robot.sign()
    assert robot.send(attachment).ok
    assert robot.send(attachment) == Answer(False, "unauthorized", False), "the first has been answered"


@pytest.mark.parametrize("late_s", [-3600.0, 61.0, 3600.0])
def test_a_query_outside_the_time_window_gets_clock_skew(robot: Robot, late_s: float):
    assert robot.send(robot.sign(late_s=late_s)) == Answer(False, "clock_skew", True)


def test_unsigned_credentials_are_refused(robot: Robot):
    for credential in (robot.api_key, "eyJhbGciOi.e30.x"):
        assert robot.send(credential) == Answer(False, "unauthorized", False)
    assert robot.send(None) == Answer(False, "unauthorized", False)


def test_a_client_signs_its_queries(service: Service, robot: Robot):
    with client(service, robot.api_key) as connected:
        for _ in range(3):
            assert connected.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
        with pytest.raises(NotFound):
            connected.localize(SCAN, map_id="attic")


def test_scopes_and_maps_of_the_key_hold(service: Service):
    api_key = give(service, "localize", maps=("yard",))
    with client(service, api_key) as connected:
        assert connected.localize(SCAN, map_id="yard").verdict is Verdict.LOCALIZED
        with pytest.raises(Forbidden):
            connected.localize(SCAN, map_id="hall")


def is_unauthorized(service: Service, api_key: str, said: str = "") -> bool:
    """Asks once. False where other tests have just used up what callers with invalid keys may ask."""
    with client(service, api_key, retry=RetryPolicy(attempts=1)) as connected:
        try:
            connected.localize(SCAN, map_id="hall")
        except RateLimited:
            return False
        except Unauthorized as error:
            return re.search(said, str(error)) is not None
    raise AssertionError("it was answered")


def test_a_client_with_an_unknown_key_gets_unauthorized(service: Service, robot: Robot):
    unknown = f"ffx_{'0' * 12}_{'0' * 64}"
    wait_until(lambda: is_unauthorized(service, unknown, "no such API key.*no signature"))
    ApiKeys(service.catalog.store).revoke(robot.key.key_id)
    wait_until(lambda: not robot.send(robot.sign()).ok)
    wait_until(lambda: is_unauthorized(service, robot.api_key))


@pytest.mark.parametrize("ahead_s", [-86400.0 * 400, 3600.0])
def test_a_robot_with_a_wrong_clock_asks_again(service, robot, monkeypatch, ahead_s):
    class WrongTime:
        monotonic = staticmethod(time.monotonic)
        looks = 0

        @classmethod
        def time(cls) -> float:
            cls.looks += 1
            return time.time() + ahead_s

    monkeypatch.setattr(zenoh_ask, "time", WrongTime)
    with client(service, robot.api_key) as connected:
        for _ in range(3):
            assert connected.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
    assert WrongTime.looks == 1, "after that it goes by the service's clock"


def test_a_token_is_not_sent_over_an_open_zenoh(service: Service):
    with pytest.raises(InvalidOption, match="no API key"):
        ZenohClient("tcp/192.0.2.1:7447", api_key="eyJhbGciOi.e30.x", timeout_s=1.0)
    with (
        client(service, "eyJhbGciOi.e30.x", retry=RetryPolicy(attempts=1)) as connected,
        pytest.raises(Unauthorized, match="signed queries"),
    ):
        connected.localize(SCAN, map_id="hall")


class Liar:
    """A stranger who answers whatever he can, and with whatever he likes."""

    def __init__(self, service: Service, reply: Any) -> None:
        self.asked = 0
        self._reply = reply
        self.session = client_session(service.endpoint)
        keys = ("firstfix/*/localize/**", "firstfix/**")
        self.queryables = [self.session.declare_queryable(key, self._on_query, complete=True) for key in keys]
        self.token = self.session.liveliness().declare_token(f"{KEY}/liar")
        look = client_session(service.endpoint)
        wait_until(lambda: list(look.liveliness().get(f"{KEY}/liar", timeout=5)))
        look.close()

    def _on_query(self, query: Any) -> None:
        self.asked += 1
        with query:
            self._reply(query)


def false_answer(query: Any) -> None:
    answer = {"verdict": "rejected", "reasons": ["no_candidate"], "T_map_sensor": None, "covariance": None}
    query.reply(query.key_expr, json.dumps(answer), encoding="application/json;firstfix-v1=" + "0" * 64)


def false_error(query: Any) -> None:
    body = {"code": "clock_skew", "detail": "it is 1970", "status": 401, "time_ms": 1}
    query.reply_err(json.dumps(body), encoding="application/problem+json")


def no_answer(query: Any) -> None:
    """End the query without a reply."""


@pytest.mark.parametrize("reply", [false_answer, false_error, no_answer])
def test_a_client_ignores_unsigned_answers(service: Service, robot: Robot, reply: Any):
    liar = Liar(service, reply)
    try:
        with client(service, robot.api_key) as connected:
            for _ in range(8):
                assert connected.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
        assert liar.asked > 0
    finally:
        liar.session.close()


def test_unsigned_answers_alone_are_an_error(tmp_path: Path):
    with running_service(tmp_path, auth="on") as other:
        liar = Liar(other, false_answer)
        api_key = f"ffx_{'1' * 12}_{'1' * 64}"
        try:
            with (
                client(other, api_key, retry=RetryPolicy(attempts=2)) as connected,
                pytest.raises((Unauthorized, ServiceUnreachable), match="no signature"),
            ):
                connected.localize(SCAN, map_id="hall")
        finally:
            liar.session.close()
