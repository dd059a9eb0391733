"""/docs: the page of the API, its files and its rules."""

from __future__ import annotations

import re
from urllib.parse import urljoin

import pytest

from firstfix.errors import NotFound
from firstfix_service.http_api.routes import api_page
from tests.service.service_world import Service, serving


@serving(auth="on", zenoh=False)
def test_the_page_comes_with_its_files_and_asks_no_other_host(service: Service):
    page = service.http.get("/docs")
    assert (page.status_code, page.headers["content-type"]) == (200, "text/html; charset=utf-8")
    policy = page.headers["content-security-policy"]
    assert "default-src 'none'; script-src 'self'; style-src 'self';" in policy
    assert "unsafe" not in policy
    named = re.findall(r'(?:src|href)="([^"]+)"', page.text)
    files = [name for name in named if not name.startswith("data:")]
    assert {name.rpartition("/")[2] for name in files} == {
        "swagger-ui.css",
        "swagger-ui-bundle.js",
        "start.js",
        "openapi.json",
    }
    for name in files:
        assert not name.startswith(("/", "http")), "relative: a proxy may put a prefix before it"
        answer = service.http.get(urljoin(str(page.url), name))
        assert answer.status_code == 200, name
        if name != "openapi.json":
            assert answer.headers["content-security-policy"] == policy
            assert answer.headers["content-encoding"] == "gzip"
    assert not re.search(r"<script(?![^>]*src=)|\son\w+=|style=", page.text), "the policy forbids these"


@serving(auth="on", zenoh=False)
def test_other_names_lead_to_the_page_and_unknown_files_are_not_found(service: Service):
    for name in ("/redoc", "/swagger"):
        assert service.http.get(name, follow_redirects=True).url.path == "/docs"
    for name in ("/docs/other.js", "/docs/..%2Fapi_page.py"):
        assert service.http.get(name).status_code == 404


def test_without_its_package_the_error_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch):
    def absent(name: str) -> None:
        raise api_page.PackageNotFoundError(name)

    monkeypatch.setattr(api_page, "distribution", absent)
    with pytest.raises(NotFound, match=r"pip install '\.\[service\]'.*openapi\.json"):
        api_page.page_files.__wrapped__()
