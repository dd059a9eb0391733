"""The Helm chart, rendered as `helm install` would: valid, safe, and fit for the service that it runs."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml
from fastapi.testclient import TestClient

import firstfix
from firstfix_service.app import create_app
from firstfix_service.server import STOP_WITHIN_S
from firstfix_service.settings import Settings
from tests.servers import program
from tests.waiting import LIMIT_S

REPO = Path(__file__).resolve().parents[2]
CHART = REPO / "deploy" / "kubernetes" / "firstfix"
EXAMPLES = {path.stem: path for path in sorted((REPO / "deploy" / "kubernetes" / "examples").glob("*.yaml"))}
Resource = dict[str, Any]


class Refused(Exception):
    """The chart does not take these values."""


def rendered(
    *value_files: Path, values: dict[str, Any] | None = None, release: str = "firstfix"
) -> list[Resource]:
    """The resources; as strict YAML reads them.

    Raises:
        Refused: with what helm says.
    """
    helm = program("helm", "make all-test-servers builds it, with Go")
    command = [helm, "template", release, str(CHART), "--kube-version", "1.32", "--values", "-"]
    command += [part for file in value_files for part in ("--values", str(file))]
    run = subprocess.run(
        command, input=json.dumps(values or {}), capture_output=True, text=True, timeout=LIMIT_S, check=False
    )
    if run.returncode:
        raise Refused(run.stderr)
    return [resource for resource in yaml.safe_load_all(run.stdout) if resource]


def of_kind(resources: list[Resource], kind: str) -> list[Resource]:
    return [resource for resource in resources if resource["kind"] == kind]


def pod_specs(resources: list[Resource]) -> Iterator[tuple[str, Resource]]:
    """Name of the resource, and the spec of the pods that it makes."""
    for resource in resources:
        spec = resource.get("spec", {})
        if resource["kind"] == "CronJob":
            spec = spec["jobTemplate"]["spec"]
        if "template" in spec:
            yield resource["metadata"]["name"], spec["template"]["spec"]


def pod_of(resources: list[Resource]) -> Resource:
    """The spec of the service's pods."""
    return dict(pod_specs(resources))["firstfix"]


def environment(pod: Resource) -> list[Resource]:
    """The variables of the pod's one container."""
    (container,) = pod["containers"]
    return list(container["env"])


STORE = {"store": {"url": "s3://maps"}}
NATS = {"nats": {"url": "nats://nats:4222"}, "builder": {"enabled": True}}
CUSTOM = "monitoring.coreos.com/"
pytestmark = pytest.mark.slow


@pytest.fixture(params=list(EXAMPLES))
def resources(request: pytest.FixtureRequest) -> list[Resource]:
    return rendered(EXAMPLES[request.param])


@pytest.fixture(scope="module")
def full() -> list[Resource]:
    return rendered(EXAMPLES["full"])


@pytest.mark.parametrize("release", ["1.29", "1.37"])
def test_every_resource_is_what_kubernetes_takes(resources: list[Resource], release: str):
    for resource in resources:
        if not resource["apiVersion"].startswith(CUSTOM):
            kubernetes_validate.validate(resource, release, strict=True)


def test_a_misspelt_field_would_be_seen(full: list[Resource]):
    deployment = json.loads(json.dumps(of_kind(full, "Deployment")[0]))
    deployment["spec"]["template"]["spec"]["containers"][0]["readynessProbe"] = {}
    with pytest.raises(kubernetes_validate.ValidationError, match="readynessProbe"):
        kubernetes_validate.validate(deployment, "1.37", strict=True)


def problems_of(custom: list[Resource]) -> list[str]:
    """Returns the errors of the resources in the schemas of prometheus-operator."""
    package = Path(sys.prefix) / "kubernetes-models/node_modules/@kubernetes-models/prometheus-operator"
    if not package.is_dir() or shutil.which("node") is None:
        pytest.skip("needs schemas of prometheus-operator: make all-test-servers installs them, with npm")
    script = Path(__file__).with_name("check_custom_resources.mjs")
    command = ["node", str(script), str(package)]
    run = subprocess.run(command, input=json.dumps(custom), capture_output=True, text=True, check=True)
    return list(json.loads(run.stdout))


def test_prometheus_operator_takes_its_resources(full: list[Resource]):
    custom = [resource for resource in full if resource["apiVersion"].startswith(CUSTOM)]
    assert {resource["kind"] for resource in custom} == {"ServiceMonitor", "PrometheusRule"}
    assert problems_of(custom) == []
    monitor = next(resource for resource in custom if resource["kind"] == "ServiceMonitor")
    monitor = json.loads(json.dumps(monitor))
    monitor["spec"]["endpoints"][0] |= {"scheme": "ftp", "intervall": "1s"}
    assert len(problems_of([monitor])) == 2


def test_every_variable_is_a_setting(resources: list[Resource]):
    known = {f"FIRSTFIX_{name.upper()}" for name in Settings.model_fields}
    for _, pod in pod_specs(resources):
        names = [variable["name"] for variable in environment(pod)]
        assert {name for name in names if name.startswith("FIRSTFIX_")} <= known
        assert len(names) == len(set(names))


def test_the_service_takes_the_values(resources: list[Resource], monkeypatch: pytest.MonkeyPatch):
    for name, pod in pod_specs(resources):
        with monkeypatch.context() as patch:
            for variable in environment(pod):
                patch.setenv(variable["name"], variable.get("value") or "2")  # of pod name and CPUs
            settings = Settings()
        assert settings.store == variable_of(pod, "FIRSTFIX_STORE")
        if name == "firstfix":
            assert (settings.host, settings.port, settings.workers) == ("0.0.0.0", 8080, 2)
            assert settings.auth in ("on", "off")
            assert not settings.run_builds


def variable_of(pod: dict[str, Any], name: str) -> str | None:
    return next((v.get("value") for v in environment(pod) if v["name"] == name), None)


def test_numbers_and_lists_reach_the_settings(monkeypatch: pytest.MonkeyPatch):
    given = {
        "recorded_max_bytes": 85899345920,
        "pinned_maps": ["hall", "yard"],
        "read_only": True,
        "log_level": "debug",
        "answer_timeout_s": 2.5,
    }
    pod = pod_of(rendered(values={**STORE, "settings": given}))
    for variable in environment(pod):
        monkeypatch.setenv(variable["name"], variable.get("value") or "2")
    settings = Settings()
    assert {name: getattr(settings, name) for name in given} == {**given, "pinned_maps": ("hall", "yard")}


def test_replicas_hold_maps_where_they_are_told_to(full: list[Resource]):
    pod = pod_of(full)
    assert variable_of(pod, "FIRSTFIX_HOLDERS") == "2"
    pod = pod_of(rendered(values=STORE))
    assert variable_of(pod, "FIRSTFIX_HOLDERS") is None


def test_extra_variables_reach_every_pod():
    wanted = {"name": "AWS_REGION", "value": "eu-central-1"}
    found = list(pod_specs(rendered(values={**STORE, **NATS, "extraEnv": [wanted]})))
    assert len(found) == 3
    for _, pod in found:
        assert wanted in environment(pod)


def test_probes_ask_existing_routes(full: list[Resource], tmp_path: Path):
    settings = Settings(store=str(tmp_path / "store"), work_dir=tmp_path / "work", run_builds=False)
    asked = {
        container[probe]["httpGet"]["path"]
        for _, pod in pod_specs(full)
        for container in pod["containers"]
        for probe in ("startupProbe", "livenessProbe", "readinessProbe")
        if probe in container
    }
    asked |= {endpoint["path"] for endpoint in of_kind(full, "ServiceMonitor")[0]["spec"]["endpoints"]}
    assert asked == {"/healthz", "/readyz", "/metrics"}
    with TestClient(create_app(settings)) as client:
        for path in asked:
            assert client.get(path).status_code in (200, 503), path  # 503: it has not read the catalog yet


def test_scaling_uses_an_existing_metric(full: list[Resource], tmp_path: Path):
    (scaler,) = of_kind(full, "HorizontalPodAutoscaler")
    ((metric, target),) = [
        (one["pods"]["metric"]["name"], one["pods"]["target"]) for one in scaler["spec"]["metrics"]
    ]
    settings = Settings(store=str(tmp_path / "store"), work_dir=tmp_path / "work", run_builds=False)
    with TestClient(create_app(settings)) as client:
        assert f"\n# TYPE {metric} gauge\n" in client.get("/metrics").text
    service = pod_of(full)
    assert target["averageValue"] == service["containers"][0]["resources"]["requests"]["cpu"]
    deployments = {one["metadata"]["name"]: one["spec"] for one in of_kind(full, "Deployment")}
    assert "replicas" not in deployments["firstfix"]


def test_a_pod_has_time_to_drain(resources: list[Resource]):
    pod = pod_of(resources)
    drain_s = int(variable_of(pod, "FIRSTFIX_DRAIN_S") or 0)
    assert drain_s > 0
    assert pod["terminationGracePeriodSeconds"] >= drain_s + STOP_WITHIN_S + 10


def test_pods_hold_to_the_restricted_profile(resources: list[Resource]):
    for _, pod in pod_specs(resources):
        assert pod["automountServiceAccountToken"] is False
        assert pod["enableServiceLinks"] is False  # FIRSTFIX_PORT=tcp://...
        assert pod["securityContext"]["runAsNonRoot"] is True
        assert pod["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
        for container in pod["containers"]:
            assert container["securityContext"] == {
                "allowPrivilegeEscalation": False,
                "readOnlyRootFilesystem": True,
                "capabilities": {"drop": ["ALL"]},
            }
            assert container["resources"]["limits"]["memory"]
            written = {mount["mountPath"] for mount in container["volumeMounts"] if not mount.get("readOnly")}
            assert written <= {"/tmp", "/var/lib/firstfix"}
    for account in of_kind(resources, "ServiceAccount"):
        assert account["automountServiceAccountToken"] is False


def test_the_user_of_the_pods_is_that_of_the_image(full: list[Resource]):
    uid = int(re.findall(r"useradd --uid (\d+)", (REPO / "Dockerfile").read_text())[0])
    for _, pod in pod_specs(full):
        assert pod["securityContext"]["runAsUser"] == pod["securityContext"]["fsGroup"] == uid


def test_secrets_are_only_referred_to(resources: list[Resource]):
    assert not of_kind(resources, "Secret")
    for _, pod in pod_specs(resources):
        for variable in environment(pod):
            assert not re.search(r"SECRET|PASSWORD|TOKEN|ACCESS_KEY", variable["name"]), variable


def test_labels_find_their_pods(full: list[Resource]):
    pods = {}
    for deployment in of_kind(full, "Deployment"):
        template = deployment["spec"]["template"]["metadata"]["labels"]
        assert deployment["spec"]["selector"]["matchLabels"].items() <= template.items()
        pods[deployment["metadata"]["name"]] = template
    for service in of_kind(full, "Service"):
        found = [
            name for name, labels in pods.items() if service["spec"]["selector"].items() <= labels.items()
        ]
        assert found == [service["metadata"]["name"]]
    (budget,) = of_kind(full, "PodDisruptionBudget")
    (monitor,) = of_kind(full, "ServiceMonitor")
    chosen = budget["spec"]["selector"]["matchLabels"].items()
    assert [name for name, labels in pods.items() if chosen <= labels.items()] == ["firstfix"]
    watched = monitor["spec"]["selector"]["matchLabels"].items()
    assert all(watched <= service["metadata"]["labels"].items() for service in of_kind(full, "Service"))


def test_alerts_and_dashboard_are_those_of_deploy(full: list[Resource]):
    (rules,) = of_kind(full, "PrometheusRule")
    assert rules["spec"] == yaml.safe_load((REPO / "deploy/prometheus/alerts.yml").read_text())
    (board,) = of_kind(full, "ConfigMap")
    assert json.loads(board["data"]["firstfix.json"]) == json.loads(
        (REPO / "deploy/grafana/firstfix.json").read_text()
    )


def test_the_jobs_name_is_the_one_in_the_alerts():
    (monitor,) = of_kind(rendered(EXAMPLES["full"], release="robots"), "ServiceMonitor")
    (service, *_) = of_kind(rendered(EXAMPLES["full"], release="robots"), "Service")
    job = service["metadata"]["labels"][monitor["spec"]["jobLabel"]]
    assert f'job="{job}"' in (REPO / "deploy/prometheus/alerts.yml").read_text()


def test_metrics_are_public_without_a_key():
    def public(**monitoring: Any) -> str | None:
        found = rendered(values={**STORE, "monitoring": {"serviceMonitor": True, **monitoring}})
        return variable_of(pod_of(found), "FIRSTFIX_METRICS_PUBLIC")

    assert public() == "true"
    assert public(existingSecret="key") is None


def test_commands_are_those_of_the_command_line(full: list[Resource]):
    for name, pod in pod_specs(full):
        arguments = pod["containers"][0]["args"]
        words = [word for word in arguments if not word.startswith(("-", "$")) and not word.isdigit()]
        command = [sys.executable, "-m", "firstfix_cli.main", *words, "--help"]
        shown = subprocess.run(command, capture_output=True, text=True, check=True, env=None).stdout
        assert all(option in shown for option in arguments if option.startswith("--")), name


def test_long_release_names_still_name_replicas():
    found = rendered(values=STORE, release="release.with-dots-and-a-name-of-53-characters-in-all0")
    (deployment,) = of_kind(found, "Deployment")
    pod = f"{deployment['metadata']['name']}-0123456789-abcde"
    assert Settings(store="memory://", replica=pod).replica == pod


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({}, "/store/url"),
        ({"store": {"url": "/data/maps"}}, "/store/url"),
        ({"store": {"url": "s3://key:secret@maps"}}, "/store/url"),
        ({**STORE, "auth": "maybe"}, "/auth"),
        ({**STORE, "autoscalling": {"enabled": True}}, "autoscalling"),
        ({**STORE, "builder": {"enabled": True}}, "nats.url"),
        ({**STORE, "nats": {"url": "nats://user:password@nats:4222"}}, "/nats/url"),
        ({**STORE, "dask": {"enabled": True}}, "dask.enabled"),
        ({**STORE, "settings": {"port": 9000}}, "settings.port"),
        ({**STORE, "service": {"resources": {"requests": {"cpu": None}}}}, "requests.cpu"),
        ({**STORE, "service": {"holders": 2}}, "service.holders: .* zenoh"),
        ({**STORE, "service": {"holders": -1}}, "/service/holders"),
    ],
)
def test_invalid_values_are_refused(values: dict[str, Any], reason: str):
    with pytest.raises(Refused, match=reason):
        rendered(values=values)


@pytest.fixture(scope="module")
def dask() -> list[Resource]:
    return rendered(EXAMPLES["dask"])


def test_builders_share_their_work_where_there_is_a_cluster(dask: list[Resource]):
    pods = dict(pod_specs(dask))
    (service,) = (one for one in of_kind(dask, "Service") if "dask" in one["metadata"]["name"])
    address = f"{service['metadata']['name']}:{service['spec']['ports'][0]['port']}"
    assert variable_of(pods["firstfix-builder"], "FIRSTFIX_BUILD_EXECUTOR") == f"dask://{address}"
    assert pods["firstfix-dask-worker"]["containers"][0]["command"][-1] == f"tcp://{address}"
    assert variable_of(pods["firstfix"], "FIRSTFIX_BUILD_EXECUTOR") is None
    (deployment,) = (one for one in of_kind(dask, "Deployment") if one["metadata"]["name"].endswith("worker"))
    assert deployment["spec"]["replicas"] == 8


def test_a_dask_cluster_is_reached_by_builders_alone(dask: list[Resource]):
    policies = {one["metadata"]["name"]: one["spec"] for one in of_kind(dask, "NetworkPolicy")}

    def let_in(name: str) -> set[str]:
        peers = [peer for rule in policies[name]["ingress"] for peer in rule["from"]]
        assert all(set(peer) == {"podSelector"} for peer in peers)
        return {
            value
            for peer in peers
            for said in peer["podSelector"]["matchExpressions"]
            for value in said["values"]
        }

    assert let_in("firstfix-dask-scheduler") == {"builder", "dask-worker"}
    assert let_in("firstfix-dask-worker") == {"dask-scheduler", "dask-worker"}
    without = rendered(values={**STORE, **NATS})
    assert not [one for one in without if "dask" in one["metadata"]["name"]]


def test_the_scheduler_has_no_credentials(dask: list[Resource]):
    pods = dict(pod_specs(dask))
    assert "envFrom" in pods["firstfix-dask-worker"]["containers"][0]
    assert "envFrom" not in pods["firstfix-dask-scheduler"]["containers"][0]


def test_the_options_of_dask_exist(dask: list[Resource]):
    for name, pod in pod_specs(dask):
        (container,) = pod["containers"]
        if "dask" not in name:
            continue
        program, kind, *_ = container["command"]
        options = {word.split("=")[0] for word in container["args"] if word.startswith("--")}
        command = [sys.executable, "-m", program, kind, "--help"]
        said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        assert {option for option in options if option not in said} == set()


def test_an_empty_list_of_clients_admits_no_pod():
    policy = {"clients": [], "monitoring": []}
    for found in of_kind(rendered(values={**STORE, **NATS, "networkPolicy": policy}), "NetworkPolicy"):
        assert not found["spec"]["ingress"]


def test_the_schema_of_the_values_knows_each_of_them():
    def keys(values: Any, schema: dict[str, Any], path: str) -> None:
        if isinstance(values, dict) and schema.get("additionalProperties") is False:
            assert set(schema["properties"]) - {"global"} == set(values), path
            for name, value in values.items():
                keys(value, schema["properties"][name], f"{path}.{name}")

    schema = json.loads((CHART / "values.schema.json").read_text())
    keys(yaml.safe_load((CHART / "values.yaml").read_text()), schema, "values")


def test_the_chart_has_the_programs_version():
    chart = yaml.safe_load((CHART / "Chart.yaml").read_text())
    assert chart["version"] == chart["appVersion"] == firstfix.__version__


def test_builders_have_keys_of_their_own_where_there_are_such():
    given = {
        **STORE,
        "store": {"url": "s3://maps", "existingSecret": "all"},
        "nats": NATS["nats"],
        "dask": {"enabled": True},
    }

    def secrets(builder: dict[str, Any]) -> dict[str, str]:
        pods = pod_specs(rendered(values={**given, "builder": {"enabled": True, **builder}}))
        named = {name: pod["containers"][0].get("envFrom") for name, pod in pods}
        return {name: sources[0]["secretRef"]["name"] for name, sources in named.items() if sources}

    builders = {"firstfix-builder", "firstfix-dask-worker"}
    assert set(secrets({}).values()) == {"all"}
    own = secrets({"existingSecret": "builds"})
    assert {name for name, secret in own.items() if secret == "builds"} == builders
    assert {name for name, secret in own.items() if secret == "all"} == {"firstfix", "firstfix-garbage"}


def test_builders_have_an_identity_of_their_own_where_there_is_one():
    role = {"eks.amazonaws.com/role-arn": "arn:aws:iam::1:role/builds"}
    builder = {"enabled": True, "serviceAccountAnnotations": role}
    found = rendered(values={**STORE, **NATS, "builder": builder})
    accounts = {
        one["metadata"]["name"]: one["metadata"].get("annotations")
        for one in of_kind(found, "ServiceAccount")
    }
    assert accounts == {"firstfix": None, "firstfix-builder": role}
    named = {name: pod["serviceAccountName"] for name, pod in pod_specs(found)}
    assert named == {
        "firstfix": "firstfix",
        "firstfix-builder": "firstfix-builder",
        "firstfix-garbage": "firstfix",
    }
    shared = {pod["serviceAccountName"] for _, pod in pod_specs(rendered(values={**STORE, **NATS}))}
    assert shared == {"firstfix"}


def test_builders_reach_the_store_and_nats_alone(full: list[Resource]):
    (policy,) = (
        one for one in of_kind(full, "NetworkPolicy") if one["metadata"]["name"] == "firstfix-builder"
    )
    ports = {port["port"] for rule in policy["spec"]["egress"] for port in rule["ports"]}
    assert ports == {53, 443, 4222}


def test_a_digest_wins_over_the_tag():
    digest = f"sha256:{'5e' * 32}"
    image = {"registry": "registry.example", "tag": "2", "digests": {"builder": digest}}
    found = dict(pod_specs(rendered(values={**STORE, **NATS, "image": image})))
    assert found["firstfix"]["containers"][0]["image"] == "registry.example/firstfix-service:2"
    builder = found["firstfix-builder"]["containers"][0]
    assert builder["image"] == f"registry.example/firstfix-builder:2@{digest}"
    with pytest.raises(Refused, match="digests"):
        rendered(values={**STORE, "image": {"digests": {"service": "latest"}}})
