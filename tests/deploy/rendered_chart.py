"""The Helm chart, rendered as `helm install` would, without a cluster."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

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


def environment(pod: Resource) -> list[Resource]:
    """The variables of the pod's one container."""
    (container,) = pod["containers"]
    return list(container["env"])
