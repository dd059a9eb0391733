"""Writes a software bill of materials of this image, as CycloneDX 1.5 JSON.

    sbom.py VENV NAME VERSION >FILE

It lists the Python packages in VENV with their licences, and the Debian packages that dpkg lists. It is not
cyclonedx-bom, which knows no Debian packages, nor syft, whose makers publish no package that a lock can pin.
"""

from __future__ import annotations

import json
import platform
import subprocess
import sys
import uuid
from email.message import Message
from importlib.metadata import distributions
from pathlib import Path
from typing import Any
from urllib.parse import quote

Component = dict[str, Any]


def main(venv: Path, name: str, version: str) -> None:
    packages = next(venv.glob("lib/python3.*/site-packages"))
    components = [*debian_packages(), *python_packages(packages)]
    components.sort(key=lambda component: component["bom-ref"])
    known = "\n".join(component["bom-ref"] for component in components)
    bom = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        # The same packages give the same document.
        "serialNumber": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, known)}",
        "version": 1,
        "metadata": {"component": {"type": "container", "bom-ref": name, "name": name, "version": version}},
        "components": components,
    }
    json.dump(bom, sys.stdout, indent=1)
    sys.stdout.write("\n")


def python_packages(folder: Path) -> list[Component]:
    found = []
    for distribution in distributions(path=[str(folder)]):
        name, version = distribution.metadata["Name"], distribution.version
        purl = f"pkg:pypi/{name.lower().replace('_', '-')}@{version}"
        component: Component = {
            "type": "library",
            "bom-ref": purl,
            "name": name,
            "version": version,
            "purl": purl,
        }
        licence = licence_of(distribution.metadata)
        if licence:
            component["licenses"] = [licence]
        found.append(component)
    return found


def licence_of(metadata: Message) -> dict[str, Any] | None:
    """Returns the SPDX expression of the package, else its licence as text."""
    if metadata["License-Expression"]:
        return {"expression": metadata["License-Expression"]}
    classifiers = [c for c in metadata.get_all("Classifier", []) if c.startswith("License ::")]
    said = classifiers[0].rsplit(" :: ", 1)[-1] if classifiers else (metadata["License"] or "").strip()
    return {"license": {"name": said.splitlines()[0][:100]}} if said else None


def debian_packages() -> list[Component]:
    fields = "${db:Status-Status}\\t${binary:Package}\\t${Version}\\t${Architecture}\\n"
    listed = subprocess.run(
        ["dpkg-query", "-W", "-f", fields], check=True, capture_output=True, text=True
    ).stdout
    release = platform.freedesktop_os_release()["VERSION_CODENAME"]
    found = []
    for line in listed.splitlines():
        status, package, version, architecture = line.split("\t")
        name = package.partition(":")[0]
        if status == "installed":
            purl = f"pkg:deb/debian/{quote(name)}@{quote(version)}?arch={architecture}&distro={release}"
            found.append({"type": "library", "bom-ref": purl, "name": name, "version": version, "purl": purl})
    return found


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], sys.argv[3])
