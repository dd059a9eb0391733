"""The document of the HTTP API is whole (``docs/openapi.json`` is made from it)."""

from __future__ import annotations

from typing import Any

import pytest

from firstfix.builds.config import BuildConfig
from firstfix_service.app import create_app
from firstfix_service.http_api.schema.api_models import GeoreferenceBody
from firstfix_service.settings import Settings

DOCUMENT = create_app(Settings(store="memory://")).openapi()
CALLS = [(path, method) for path, methods in DOCUMENT["paths"].items() for method in methods]


@pytest.mark.parametrize(("path", "method"), CALLS)
def test_every_call_is_described_with_its_answers(path: str, method: str):
    call = DOCUMENT["paths"][path][method]
    assert call["description"], "its docstring"
    assert "application/problem+json" in call["responses"]["default"]["content"]
    good = {code: answer for code, answer in call["responses"].items() if code.startswith("2")}
    assert len(good) == 1
    ((code, answer),) = good.items()
    if code != "204" and method != "head":
        for media_type, content in answer["content"].items():
            assert content.get("schema"), f"{media_type} without a form"
    for parameter in call.get("parameters", ()):
        assert parameter.get("description"), parameter["name"]


def test_no_reference_leads_nowhere():
    schemas = set(DOCUMENT["components"]["schemas"])

    def references(value: Any) -> set[str]:
        if isinstance(value, dict):
            own = {value["$ref"].rsplit("/", 1)[-1]} if isinstance(value.get("$ref"), str) else set()
            return own.union(*map(references, value.values()))
        return set().union(*map(references, value)) if isinstance(value, list) else set()

    assert references(DOCUMENT) <= schemas


@pytest.mark.parametrize("name", ["MapSummary", "VersionSummary", "Activation", "Build", "Answer", "GeoPose"])
def test_what_is_answered_often_has_an_example(name: str):
    assert DOCUMENT["components"]["schemas"][name]["examples"]


def test_the_examples_are_good():
    for example in DOCUMENT["components"]["schemas"]["GeoreferenceBody"]["examples"]:
        GeoreferenceBody.model_validate(example)
    body = DOCUMENT["paths"]["/maps"]["post"]["requestBody"]["content"]["application/json"]
    for example in body["examples"].values():
        BuildConfig.parse(example["value"].get("config", {}))
