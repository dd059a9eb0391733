"""Metrics: their counts, their few labels, and their use in the dashboard and the alerts."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml
from prometheus_client import CollectorRegistry
from prometheus_client.parser import text_string_to_metric_families

import firstfix
from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.answer.quality import AlignmentQuality
from firstfix.builds.options import reported_stages
from firstfix.builds.records import FINAL_STATES
from firstfix.catalog.catalog import Catalog
from firstfix.errors import StoreUnavailable, all_errors
from firstfix.store.json_record import RecordKind
from firstfix.store.store import Store
from firstfix_service.builds.runner import STAGE_LABELS, count_build
from firstfix_service.limits.connections import EndReason
from firstfix_service.telemetry.histogram import Histogram
from firstfix_service.telemetry.metered_store import OPERATIONS, metered
from firstfix_service.telemetry.metrics import Metrics
from tests.service.service_world import (
    SCAN_BODY,
    XYZ,
    Behaviour,
    FakeLocalizer,
    Service,
    publish,
    running_service,
    serving,
)
from tests.waiting import LIMIT_S, wait_until

DEPLOY = Path(__file__).resolve().parents[3] / "deploy"


@pytest.fixture
def rejecting(service: Service, monkeypatch: pytest.MonkeyPatch) -> Service:
    """A service whose localizers reject every scan."""

    def reject(self: FakeLocalizer, scan: object, *_: object) -> Localization:
        places = (Hypothesis(np.eye(4), AlignmentQuality(0.2, 0.3, 0.1), 0.07, 3, "hall"),)
        reasons = (Reason.LOW_INLIER_RATIO, Reason.LOW_PROBABILITY)
        return Localization(Verdict.REJECTED, reasons, probability=0.07, hypotheses=places)

    monkeypatch.setattr(FakeLocalizer, "localize", reject)
    return service


def test_reasons_and_probabilities_of_answers_are_counted(rejecting: Service):
    wait_until(lambda: rejecting.ask("zenoh").ok)
    assert rejecting.value("firstfix_reasons_total", reason="low_inlier_ratio") >= 1
    assert rejecting.value("firstfix_reasons_total", reason="no_candidate") == 0
    assert rejecting.value("firstfix_probability_bucket", verdict="rejected", le="0.05") == 0
    assert rejecting.value("firstfix_probability_bucket", verdict="rejected", le="0.1") >= 1


def test_queries_of_both_transports_are_timed(service: Service):
    wait_until(lambda: service.ask("http").ok)
    before = service.value("firstfix_localize_seconds_count", transport="http")
    service.ask("http")
    service.ask("http", map_id="attic")
    service.ask("zenoh")
    assert service.value("firstfix_localize_seconds_count", transport="http") == before + 2
    assert service.value("firstfix_localize_seconds_count", transport="zenoh") == 1
    assert service.value("firstfix_stage_seconds_count", stage="queue") >= 2


@serving(zenoh=False, max_versions=1, poll_interval_s=60, maps={})
def test_the_cache_counts_hits_misses_and_evictions(service: Service):
    for map_id, label in (("hall", "1"), ("yard", "2")):
        publish(service.catalog, map_id, label, service.scratch)
    for map_id in ("hall", "hall", "yard"):
        assert service.ask("http", map_id=map_id).ok
    assert service.value("firstfix_cache_lookups_total", result="miss") == 2
    assert service.value("firstfix_cache_lookups_total", result="hit") == 1
    assert service.value("firstfix_version_evictions_total") == 1
    assert service.value("firstfix_version_loads_total", result="ok") == 2


def test_the_store_is_timed_and_its_failures_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    metrics = Metrics()
    store = metered(Store.open(str(tmp_path)), metrics)

    def count(name: str, **labels: str) -> float:
        return metrics.registry.get_sample_value(name, labels) or 0.0

    catalog = Catalog(store)
    assert catalog.map_ids() == []
    store.put("a/b", b"1")
    assert store.get("a/b") == b"1"
    assert not store.exists("a/c")
    assert store.list("a") == ["a/b"]
    for operation in ("folders", "put", "get", "size", "scan"):
        assert count("firstfix_store_seconds_count", operation=operation) == 1, operation
    store.download("a/b", tmp_path / "copy")
    assert count("firstfix_store_seconds_count", operation="download") == 1
    assert count("firstfix_store_seconds_count", operation="size") == 1, (
        "a part of the download is not counted"
    )
    assert 0 < count("firstfix_store_seconds_sum", operation="put") < LIMIT_S

    def fails(self: Store, key: str) -> int:
        raise StoreUnavailable("gone")

    monkeypatch.setattr(Store, "size", fails)
    with pytest.raises(StoreUnavailable):
        store.download("a/b", tmp_path / "copy")
    assert count("firstfix_store_errors_total", operation="download", code="store_unavailable") == 1
    assert count("firstfix_store_errors_total", operation="size", code="store_unavailable") == 0


def test_every_operation_of_the_store_is_metered():
    derived = {"open", "open_at", "open_cache", "exists", "list", "pieces", "now"}
    of_the_disk = {"local_path", "directory", "probe", "remove_leftovers", "check_room"}
    public = {name for name in vars(Store) if not name.startswith("_")}
    assert public == derived | of_the_disk | set(OPERATIONS)


def test_stages_of_builds_that_ended_are_counted(tmp_path: Path):
    metrics, catalog = Metrics(), Catalog(Store.open(str(tmp_path)))
    catalog.builds.put("b1", {"map_id": "hall"})
    count_build(catalog.builds, metrics, "b1", "failed")
    catalog.builds.set_stages(
        "b1",
        [
            {"stage": "read_map", "seconds": 2.5, "cached": False},
            {"stage": "self_test", "seconds": 0.1, "cached": True},
            {"stage": "hall-of-mirrors", "seconds": 1.0, "cached": False},
        ],
    )
    count_build(catalog.builds, metrics, "b1", "succeeded")

    def count(name: str, **labels: str) -> float | None:
        return metrics.registry.get_sample_value(name, labels)

    assert (
        count("firstfix_builds_total", state="failed")
        == count("firstfix_builds_total", state="succeeded")
        == 1
    )
    assert count("firstfix_build_stage_seconds_sum", stage="read_map", cached="no") == 2.5
    assert count("firstfix_build_stage_seconds_count", stage="self_test", cached="yes") == 1
    assert count("firstfix_build_stage_seconds_count", stage="other", cached="no") == 1
    assert count("firstfix_build_stage_seconds_count", stage="hall-of-mirrors", cached="no") is None


@pytest.mark.parametrize("record", [b"[]", b"{}", b'{"stages": 1}', b'{"stages": [{"stage": []}]}', b"\xff"])
def test_an_invalid_record_of_stages_is_ignored(tmp_path: Path, record: bytes):
    metrics, catalog = Metrics(), Catalog(Store.open(str(tmp_path)))
    catalog.store.put("builds/b1/stages.json", record)
    count_build(catalog.builds, metrics, "b1", "failed")
    assert metrics.registry.get_sample_value("firstfix_builds_total", {"state": "failed"}) == 1


def test_each_stage_that_a_build_reports_is_a_label():
    assert set(reported_stages(provisional=True)) == STAGE_LABELS
    assert "provisional" in STAGE_LABELS


def test_version_process_and_zenoh_are_shown(service: Service):
    wait_until(lambda: service.value("firstfix_zenoh_maps") == 1)
    # the test's own session
    wait_until(lambda: service.value("firstfix_zenoh_connections") == 1)
    infos = [dict(labels) for name, labels in samples_of(service) if name == "firstfix_info"]
    assert [info["version"] for info in infos] == [firstfix.__version__]
    assert service.value("process_resident_memory_bytes") > 1e6
    assert service.value("firstfix_catalog_age_seconds") < LIMIT_S


QUERY_STAGES = {"queue", "map", "decode", "preprocess", "describe", "search", "register", "verify"}
CODES = {cls.code for cls in all_errors()}


def test_labels_have_fixed_values(tmp_path: Path):
    """The values of every label come from a fixed set. A new label must be added here."""
    with running_service(tmp_path, recorded_share=1.0, behaviour=Behaviour()) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        publish(service.catalog, "attic-of-the-museum", "unreadable", service.scratch)
        wait_until(lambda: service.ask("http").ok)
        for transport in ("http", "zenoh"):
            service.ask(transport)
            service.ask(transport, map_id="some-map")
            service.ask(transport, map_id="attic-of-the-museum")
            service.ask(transport, options={"version": "0" * 64})
            service.ask(transport, options={"made-up": "thing"})
            service.ask(transport, media_type="image/odd", body=b"free text")
            service.ask(transport, content_encoding="curious")
        service.http.get("/never/heard/of", headers={"X-Request-Id": "a-request", "User-Agent": "somebody"})
        service.http.request("BREW", "/maps/some-map")
        service.http.get("/builds/some-build")
        routes = {*service.app.openapi()["paths"], "/metrics", "/openapi.json"}
        allowed = {
            "transport": {"http", "zenoh"},
            "verdict": {verdict.value for verdict in Verdict},
            "reason": {reason.value for reason in Reason},
            "code": CODES,
            "stage": QUERY_STAGES | STAGE_LABELS | {"other"},
            "cached": {"yes", "no"},
            "method": {"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "other"},
            "route": routes | {"unknown"},
            "status": {"0", "200", "202", "400", "404", "405", "415", "503"},
            "state": set(FINAL_STATES),
            "why": {why.value for why in EndReason},
            "operation": set(OPERATIONS),
            "version": {firstfix.__version__},
            "kind": {kind.value for kind in RecordKind},
        }
        results = {
            "firstfix_cache_lookups": {"hit", "miss"},
            "firstfix_version_loads": {"ok", *CODES},
            "firstfix_version_warm_ups": {"ok", "failed"},
            "firstfix_verified_objects": {"right", "damaged"},
            "firstfix_sightings": {"counted", "repeated", "dropped", "full", "failed", "not_stored"},
            "firstfix_recorded_queries": {"recorded", "failed", "dropped", "rate_limited", "too_large"},
        }
        seen = 0
        for family in text_string_to_metric_families(service.http.get("/metrics").text):
            if not family.name.startswith("firstfix"):
                continue
            for sample in family.samples:
                for label, text in sample.labels.items():
                    seen += 1
                    if label in ("le", "python"):
                        continue
                    known = (
                        results[family.name.removesuffix("_created")] if label == "result" else allowed[label]
                    )
                    assert text in known, (sample.name, label, text)
        assert seen > 100


# The files in deploy/

_FUNCTIONS = {"by", "without", "on", "ignoring", "and", "or", "unless", "bool", "offset", "le"}
_PROMETHEUS_OWN = {"up"}


def names_in(expression: str) -> set[tuple[str, frozenset[str]]]:
    """Finds the metrics of a PromQL expression, each with its selected labels."""
    plain = re.sub(r'"[^"]*"', '""', expression)
    plain = re.sub(r"\[[^\]]*\]", "", plain)
    plain = re.sub(r"\b(by|without|on|ignoring)\s*\([^)]*\)", "", plain)
    found = re.finditer(r"([a-z_][a-z0-9_]*)\s*(\{([^}]*)\})?(?!\s*[a-z0-9_(])", plain)
    return {
        (match[1], frozenset(re.findall(r"(\w+)\s*[=!]", match[3] or "")))
        for match in found
        if match[1] not in _FUNCTIONS
    }


def grouped_by(expression: str) -> set[str]:
    return {
        label.strip()
        for labels in re.findall(r"\bby\s*\(([^)]*)\)", expression)
        for label in labels.split(",")
    }


def test_promql_names_are_found():
    expression = (
        'sum by (le, a) (rate(x_bucket{b=~"y", c!="rate(no)"}[5m])) / on (z) w > 3 and up{job="q"} == 0'
    )
    assert names_in(expression) == {
        ("x_bucket", frozenset({"b", "c"})),
        ("w", frozenset()),
        ("up", frozenset({"job"})),
    }
    assert grouped_by(expression) == {"le", "a"}


def dashboard_expressions() -> Iterator[str]:
    dashboard = json.loads((DEPLOY / "grafana" / "firstfix.json").read_text())
    for panel in dashboard["panels"]:
        for target in panel.get("targets", ()):
            yield target["expr"]


def alert_rules() -> list[dict[str, object]]:
    groups = yaml.safe_load((DEPLOY / "prometheus" / "alerts.yml").read_text())["groups"]
    return [rule for group in groups for rule in group["rules"]]


def shown(registry: CollectorRegistry) -> dict[str, set[str]]:
    """Names of the samples in an app's registry, with their labels."""
    found: dict[str, set[str]] = {}
    for collector in list(registry._collector_to_names):
        for name in registry._collector_to_names[collector]:
            found[name] = set(getattr(collector, "_labelnames", ()))
            if isinstance(collector, Histogram):
                found[name].add("le")
    return found


def test_dashboard_and_alerts_use_existing_metrics(service: Service):
    there = shown(service.app.state.metrics.registry)
    for name, _ in samples_of(service):
        there.setdefault(name, set())
    expressions = [*dashboard_expressions(), *(str(rule["expr"]) for rule in alert_rules())]
    asked = set()
    for expression in expressions:
        labels_there: set[str] = {"instance", "job"}
        for name, labels in names_in(expression):
            if name in _PROMETHEUS_OWN:
                continue
            assert name in there, (name, expression)
            info = {"version", "python"} if name == "firstfix_info" else set()
            labels_there |= there[name] | info
            assert labels <= {*there[name], *info, "instance", "job"}, (name, labels)
            asked.add(re.sub(r"_(total|bucket|sum|count)$", "", name))
        assert grouped_by(expression) <= labels_there, expression
    ours = {family.name for family in text_string_to_metric_families(service.http.get("/metrics").text)}
    ours = {name for name in ours if name.startswith("firstfix") and not name.endswith("_created")}
    assert ours - asked == set(), "every metric of ours is on the dashboard or in an alert"


def test_the_dashboard_can_be_provisioned():
    dashboard = json.loads((DEPLOY / "grafana" / "firstfix.json").read_text())
    assert dashboard["uid"] == "firstfix"
    assert "id" not in dashboard
    variables = {variable["name"]: variable for variable in dashboard["templating"]["list"]}
    assert variables["datasource"]["type"] == "datasource"
    ids = [panel["id"] for panel in dashboard["panels"]]
    assert len(set(ids)) == len(ids)
    for panel in dashboard["panels"]:
        place = panel["gridPos"]
        assert place["x"] + place["w"] <= 24
        if panel["type"] != "row":
            assert panel["datasource"]["uid"] == "${datasource}"
            assert panel["targets"]
            assert len({target["refId"] for target in panel["targets"]}) == len(panel["targets"])


def test_every_alert_has_a_severity_and_a_summary():
    rules = alert_rules()
    assert len({rule["alert"] for rule in rules}) == len(rules) >= 8
    for rule in rules:
        assert rule["labels"]["severity"] in ("warning", "critical")  # type: ignore[index]
        assert rule["annotations"]["summary"]  # type: ignore[index]


def test_a_query_without_a_map_is_timed(service: Service):
    service.http.post("/localize", content=SCAN_BODY, headers={"Content-Type": XYZ})
    assert service.value("firstfix_localize_seconds_count", transport="http") == 1


def samples_of(service: Service) -> list[tuple[str, dict[str, str]]]:
    """Names and labels of what a service shows."""
    families = text_string_to_metric_families(service.http.get("/metrics").text)
    return [(sample.name, sample.labels) for family in families for sample in family.samples]
