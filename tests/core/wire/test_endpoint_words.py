"""Errors of the zenoh library in words for its users."""

from __future__ import annotations

import pytest
import zenoh

from firstfix.errors import InvalidOption
from firstfix.wire.endpoints import said_by_zenoh
from firstfix_client import RetryPolicy, ServiceUnreachable, ZenohClient


def test_places_in_the_sources_of_the_library_are_left_out():
    config = zenoh.Config()
    with pytest.raises(zenoh.ZError) as caught:
        config.insert_json5("connect/endpoints", '["localhost:7447"]')
    assert ".rs:" in str(caught.value), "else this function is no longer needed"
    said = said_by_zenoh(caught.value)
    assert (
        said == "Endpoints must be of the form <protocol>/<address>[?<metadata>][#<config>]: localhost:7447"
    )


def test_an_endpoint_without_a_protocol_is_told_its_form():
    with pytest.raises(InvalidOption, match="an endpoint is like tcp/HOST:7447") as caught:
        ZenohClient("localhost:7447")
    assert ".rs" not in str(caught.value)


def test_nobody_at_an_endpoint_is_said_in_words():
    with pytest.raises(ServiceUnreachable, match=r"no zenoh peer at tcp/127\.0\.0\.1:9") as caught:
        ZenohClient("tcp/127.0.0.1:9", timeout_s=0.2, retry=RetryPolicy(patience_s=0.1))
    assert ".rs" not in str(caught.value)
