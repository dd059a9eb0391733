from __future__ import annotations

import json
from http import HTTPStatus

import httpx
import pytest

from firstfix.errors import ClockSkew, FirstfixError, Overloaded, StoreUnavailable, all_errors
from firstfix_service.problems import STATUS, TITLES, problem_of


def test_every_error_class_has_its_own_row():
    assert set(STATUS) == set(all_errors())


@pytest.mark.parametrize("error", all_errors(), ids=lambda cls: cls.__name__)
def test_a_problem_document_is_complete(error: type[FirstfixError]):
    problem = problem_of(error("why"))
    body = json.loads(problem.body)
    own = {"time_ms"} if error is ClockSkew else set()
    assert set(body) == {"type", "title", "status", "detail", "code", *own}
    assert body["code"] == error.code
    assert body["status"] == problem.status
    assert 400 <= problem.status < 600
    assert body["title"] == TITLES.get(problem.status) or HTTPStatus(problem.status).phrase


def test_retry_after_is_given_where_trying_again_helps():
    for error in (Overloaded("full"), StoreUnavailable("gone")):
        assert int(problem_of(error).headers["Retry-After"]) >= 1


def test_a_subclass_has_the_status_of_its_parent():
    class Worse(Overloaded):
        code = "worse"

    assert problem_of(Worse("x")).status == 503


@pytest.mark.parametrize(
    ("method", "path", "status", "code"),
    [
        ("GET", "/nowhere", 404, "not_found"),
        ("PUT", "/localize", 405, "method_not_allowed"),
        ("GET", "/maps/-bad-", 400, "invalid_option"),
        ("GET", "/maps/attic", 404, "not_found"),
        ("GET", "/maps/attic/versions", 404, "not_found"),
        ("POST", f"/maps/hall/versions/{'0' * 64}/activate", 404, "not_found"),
        ("POST", "/maps/hall/versions/short/activate", 400, "invalid_option"),
        ("GET", "/builds/none", 404, "not_found"),
        ("DELETE", "/builds/none", 404, "not_found"),
        ("POST", "/maps", 415, "unsupported_format"),
    ],
)
def test_refusals_are_problem_documents(shared_service, method, path, status, code):
    response: httpx.Response = shared_service.http.request(method, path)
    assert response.headers["content-type"] == "application/problem+json"
    assert (response.status_code, response.json()["code"]) == (status, code)
    assert response.json()["status"] == status


@pytest.mark.parametrize(
    ("method", "path", "allowed"),
    [
        ("PUT", "/maps", {"GET", "POST"}),
        ("PUT", "/maps/hall", {"DELETE", "GET"}),
        ("GET", "/localize", {"POST"}),
    ],
)
def test_a_method_that_is_not_allowed_is_told_all_that_are(shared_service, method, path, allowed):
    response: httpx.Response = shared_service.http.request(method, path)
    assert response.status_code == 405
    assert set(response.headers["allow"].split(", ")) == allowed
