"""Random requests, made by schemathesis, against the promises of the OpenAPI document."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from datetime import datetime, timezone

import pytest
import schemathesis
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from schemathesis import Case, GenerationMode, Response
from schemathesis.checks import CheckContext
from schemathesis.schemas import APIOperation
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Grant
from firstfix.catalog.recorded_queries import RecordedQueries, RecordedQuery, new_query_id
from firstfix.catalog.uploads.uploads import Uploads
from firstfix.scan_formats import MEDIA_TYPES
from firstfix_service.app import create_app
from firstfix_service.settings import Settings
from tests.service.service_world import SCAN_BODY, XYZ, Service, publish, running_service
from tests.waiting import LIMIT_S

pytestmark = pytest.mark.slow

EXAMPLES = 12  # an operation


def no_defect(context: CheckContext, response: Response, case: Case) -> None:
    """503 says "not now": everything else from 500 on is ours to mend."""
    assert response.status_code < 500 or response.status_code == 503, response.text


CHECKS = [
    no_defect,
    status_code_conformance,
    content_type_conformance,
    response_schema_conformance,
    response_headers_conformance,
]


SCHEMA = schemathesis.openapi.from_dict(create_app(Settings(store="memory://")).openapi())
# Streams that do not end by themselves, as the build that is found does not.
STREAMS = {"/builds/{build_id}/events", "/answers/events"}
CALLS = [result.ok() for result in SCHEMA.get_all_operations() if result.ok().path not in STREAMS]


schemathesis.serializer.alias([*MEDIA_TYPES, "application/offset+octet-stream"], "application/octet-stream")


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """One for all calls. It must survive each of them. Each has its own map, build and upload."""
    changes = {"max_upload_bytes": 1 << 20, "source_urls": ("s3://maps/",), "zenoh": False}
    with running_service(tmp_path_factory.mktemp("service"), **changes) as running:
        yield running


@pytest.fixture
def known(service: Service) -> dict[str, str]:
    """Path parameters of existing objects."""
    names = {kind: f"{kind}-{uuid.uuid4().hex[:12]}" for kind in ("map", "build", "upload")}
    version = publish(service.catalog, names["map"], "1", service.scratch)
    service.catalog.builds.put(names["build"], {"map_id": names["map"]})
    uploads = Uploads(service.catalog.store)
    uploads.create(names["upload"], size_bytes=1000, file_name="hall.ply")
    query_id = new_query_id(uuid.uuid4().hex[:8], datetime.now(timezone.utc))
    answer = {"verdict": "rejected", "reasons": ["low_probability"], "probability": 0.2}
    recorded = RecordedQuery(query_id, "", "http", "r", "", names["map"], XYZ, "", {}, answer, len(SCAN_BODY))
    RecordedQueries(service.catalog.store).put(recorded, SCAN_BODY)
    key, _ = ApiKeys(service.catalog.store).create(names["map"], Grant.parse(["localize"], [names["map"]]))
    return {
        "map_id": names["map"],
        "version": version,
        "build_id": names["build"],
        "upload_id": names["upload"],
        "query_id": query_id,
        "key_id": key.key_id,
    }


@pytest.mark.parametrize("call", CALLS, ids=lambda call: call.label)
def test_every_call_answers_as_the_document_says(call: APIOperation, service: Service, known: dict[str, str]):
    @settings(
        max_examples=EXAMPLES,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(
        case=call.as_strategy() | call.as_strategy(generation_mode=GenerationMode.NEGATIVE),
        there=st.booleans(),
    )
    def holds(case: Case, there: bool) -> None:
        if there:
            case.path_parameters = {name: known[name] for name in case.path_parameters or {}}
        case.call_and_validate(base_url=service.url, checks=CHECKS, timeout=LIMIT_S)

    holds()
