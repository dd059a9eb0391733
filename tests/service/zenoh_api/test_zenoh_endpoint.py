"""The zenoh endpoint of a replica: its keys and tokens, its limits, its start and its end."""

from __future__ import annotations

import asyncio
import dataclasses
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
import zenoh

from firstfix.errors import InvalidOption
from firstfix_service.app import create_app
from firstfix_service.settings import Settings
from firstfix_service.zenoh_api.config import session_config
from tests.service.service_world import (
    SCAN_BODY,
    XYZ,
    Service,
    client_session,
    free_port,
    publish,
    running_service,
    serving,
)
from tests.waiting import LIMIT_S, wait_until


def tokens(session: Any, map_id: str) -> set[str]:
    replies = session.liveliness().get(f"firstfix/{map_id}/localize/*", timeout=5)
    return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}


def test_a_replica_shows_the_maps_it_serves(service: Service):
    wait_until(lambda: tokens(service.session, "hall") == {"firstfix/hall/localize/r1"})
    assert tokens(service.session, "attic") == set()
    publish(service.catalog, "attic", "5", service.scratch)
    wait_until(lambda: tokens(service.session, "attic"))
    version = service.catalog.active_version("attic")
    assert version is not None
    service.catalog.retire("attic", version, force=True)
    wait_until(lambda: not tokens(service.session, "attic"))


def test_a_replica_answers_on_its_own_key_and_for_all(service: Service):
    for key in ("firstfix/hall/localize/r1", "firstfix/hall/localize/*"):
        replies = list(service.session.get(key, payload=SCAN_BODY, encoding=XYZ, timeout=LIMIT_S))
        assert [str(reply.ok.key_expr) for reply in replies] == ["firstfix/hall/localize/r1"]
    assert list(service.session.get("firstfix/hall/localize/other", payload=SCAN_BODY, timeout=2)) == []


def test_two_replicas_share_the_maps(tmp_path: Path):
    port = free_port()
    shared = str(tmp_path / "store")
    listen = f"tcp/127.0.0.1:{port}"
    with (
        running_service(tmp_path / "a", store=shared, zenoh_listen=(listen,), replica="r1") as first,
        running_service(tmp_path / "b", store=shared, replica="r2", zenoh_connect=(listen,)) as second,
    ):
        publish(first.catalog, "hall", "1", tmp_path / "made")
        both = {"firstfix/hall/localize/r1", "firstfix/hall/localize/r2"}
        peer = _peer([listen, second.endpoint])
        try:
            wait_until(lambda: tokens(peer, "hall") == both)
            for key in both:
                (reply,) = peer.get(key, payload=SCAN_BODY, encoding=XYZ, timeout=LIMIT_S)
                assert str(reply.ok.key_expr) == key
            every = peer.get(
                "firstfix/hall/localize/*",
                payload=SCAN_BODY,
                encoding=XYZ,
                timeout=LIMIT_S,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
            )
            assert {str(reply.ok.key_expr) for reply in every} == both
            one = list(peer.get("firstfix/hall/localize", payload=SCAN_BODY, encoding=XYZ, timeout=LIMIT_S))
            assert len(one) == 1, "the shared key costs one replica's work"
        finally:
            peer.close()


def _peer(endpoints: list[str]) -> Any:
    settings = Settings(store="memory://", zenoh_listen=(), zenoh_connect=tuple(endpoints))
    return zenoh.open(session_config(settings))


@serving(is_gated=True, workers=2)
def test_queries_run_in_parallel(service: Service):
    with ThreadPoolExecutor(2) as threads:
        replies = [threads.submit(service.ask_zenoh) for _ in range(2)]
        assert service.behaviour.started.acquire(timeout=LIMIT_S)
        assert service.behaviour.started.acquire(timeout=LIMIT_S), (
            "the second began while the first was under way"
        )
        service.open_gate()
        assert all(reply.result().ok for reply in replies)


def test_a_scan_of_many_megabytes_is_answered(service: Service):
    body = bytes(12 * 1_500_000)
    assert service.ask_zenoh(body=body).json["T_map_sensor"]["position"][1] == 1_500_000


@pytest.mark.parametrize("key", ["firstfix/*/localize", "firstfix/Bad%20Name/localize"])
def test_a_key_of_no_or_several_maps_is_refused(service: Service, key: str):
    assert service.ask_zenoh(key=key).json["code"] == "invalid_option"


def test_a_query_needs_a_payload_and_single_options(service: Service):
    for encoding in (XYZ, None):
        (reply,) = service.session.get("firstfix/hall/localize", encoding=encoding, timeout=LIMIT_S)
        assert b'"malformed_data"' in reply.err.payload.to_bytes()
    (reply,) = service.session.get("firstfix/hall/localize", payload=SCAN_BODY, timeout=LIMIT_S)
    assert b'"unsupported_format"' in reply.err.payload.to_bytes(), "rows of numbers have no signature"
    selector = "firstfix/hall/localize?version=a;version=b"
    (reply,) = service.session.get(selector, payload=SCAN_BODY, encoding=XYZ, timeout=LIMIT_S)
    assert b"more than once" in reply.err.payload.to_bytes()
    (reply,) = service.session.get(
        "firstfix/hall/localize?_time=[now(-1h)..]", payload=SCAN_BODY, encoding=XYZ, timeout=LIMIT_S
    )
    assert reply.ok is not None, "zenoh's own parameters are not options"


def test_stopping_takes_the_tokens_back(tmp_path: Path):
    with running_service(tmp_path) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        wait_until(lambda: tokens(service.session, "hall"))
        peer = client_session(service.endpoint)
    assert tokens(peer, "hall") == set()
    peer.close()


def test_the_configuration_file_is_used_as_it_is(tmp_path: Path):
    port = free_port()
    path = tmp_path / "zenoh.json5"
    path.write_text(
        f'{{mode: "router", listen: {{endpoints: ["tcp/127.0.0.1:{port}"]}}, '
        "scouting: {multicast: {enabled: false}}}"
    )
    settings = Settings(store="memory://", zenoh_config=path, max_body_bytes=1000)
    assert settings.zenoh_enabled
    config = session_config(settings)
    assert config.get_json("mode") == '"router"'
    assert config.get_json("transport/link/rx/max_message_size") == "1500"


def test_a_bad_file_or_a_taken_port_stops_the_start(tmp_path: Path, service: Service):
    with pytest.raises(InvalidOption, match="zenoh"):
        session_config(Settings(store="memory://", zenoh_config=tmp_path / "none.json5"))
    second = Settings(
        store=str(tmp_path / "second"),
        cache_dir=tmp_path / "cache",
        work_dir=tmp_path / "work",
        zenoh=True,
        zenoh_listen=(service.endpoint,),
    )

    async def start() -> None:
        app = create_app(second)
        async with app.router.lifespan_context(app):
            pytest.fail("it started on an endpoint that is taken")

    with pytest.raises(InvalidOption, match="zenoh"):
        asyncio.run(start())


def other_client(service: Service) -> Service:
    """The service through another session, which knows the service's keys already."""
    session = client_session(service.endpoint)
    wait_until(lambda: list(session.liveliness().get("firstfix/@any/localize/*", timeout=5)))
    return dataclasses.replace(service, session=session)


@serving(max_body_bytes=1 << 20)
def test_a_message_over_the_limit_harms_no_query(service: Service):
    other = other_client(service)
    replies = other.session.get("firstfix/hall/localize", payload=bytes(3 << 20), encoding=XYZ, timeout=2)
    assert not any(reply.ok for reply in replies)
    assert service.value("firstfix_localize_failures_total") == 0, "the service has not seen it"
    assert service.ask_zenoh().ok
    assert other.ask_zenoh().ok, "also who sent it is answered"
    other.session.close()


def test_every_query_of_a_crowd_is_answered_or_refused(service: Service):
    def ask(_: int) -> str:
        reply = service.ask_zenoh()
        return "ok" if reply.ok else reply.json["code"]

    with ThreadPoolExecutor(64) as threads:
        outcomes = list(threads.map(ask, range(400)))
    assert set(outcomes) <= {"ok", "overloaded"}
    assert outcomes.count("ok") >= 34, "as many as have a place"
    wait_until(lambda: service.ask_zenoh().ok)  # its place is free just after its answer


@serving(is_gated=True, workers=1)
def test_stopping_answers_all_waiting_queries(service: Service):
    with ThreadPoolExecutor(5) as threads:
        asked = other_client(service)
        peer = asked.session
        waiting = [threads.submit(asked.ask_zenoh) for _ in range(5)]
        wait_until(lambda: service.value("firstfix_queries_admitted") == 5)
        service.stop()
        key = "firstfix/hall/localize/r1"
        wait_until(lambda: not list(peer.liveliness().get(key, timeout=5)))
        service.open_gate()
        assert all(reply.result(LIMIT_S).ok for reply in waiting), "one worker, five queries"
        peer.close()
