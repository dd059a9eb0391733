"""Takes out of an image's packages what no running program needs, and proves that the rest still loads.

    slim.py VENV service    also drops the parts of SciPy that only builds could want
    slim.py VENV builder

Run with the system's Python while an image is made; needs binutils' strip. What was installed stays told by
the packages' own metadata, so the bill of materials is not touched.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

# Of SciPy the service has k-d trees, rotations and a minimizer; these parts are behind none of them.
UNUSED_BY_SERVICE = [
    f"scipy/{part}"
    for part in ("cluster", "datasets", "differentiate", "fftpack", "integrate", "interpolate", "io", "misc")
    + ("ndimage", "odr", "signal", "stats")
]
STRIPPED_FROM_BYTES = 500_000

# Every module of ours, and what it loads only when asked to. It leaves the bytecode of what it loads behind:
# in the service's image there is no other.
LOAD_ALL = """
import importlib, pkgutil, sys
for root in sys.argv[1:]:
    package = importlib.import_module(root)
    for module in pkgutil.walk_packages(package.__path__, root + "."):
        importlib.import_module(module.name)
import jwt, nats, rosbags.rosbag1, rosbags.rosbag2, uvicorn.loops.uvloop, zenoh
import opentelemetry.exporter.otlp.proto.http.trace_exporter, opentelemetry.sdk.trace.export
"""
LOAD_DASK = "import distributed.cli.dask_scheduler, distributed.cli.dask_worker, distributed.nanny"
SERVICE_PACKAGES = ["firstfix", "firstfix_service", "firstfix_client", "firstfix_cli"]


def main(venv: Path, kind: str) -> None:
    packages = next(venv.glob("lib/python3.*/site-packages"))
    remove(packages, UNUSED_BY_SERVICE if kind == "service" else [])
    for library in packages.rglob("*.so"):
        # Those in *.libs were patched by auditwheel: strip would break them, and they have no debug symbols.
        if not library.parent.name.endswith(".libs") and library.stat().st_size >= STRIPPED_FROM_BYTES:
            subprocess.run(["strip", "--strip-unneeded", library], check=True)
    roots = SERVICE_PACKAGES if kind == "service" else [*SERVICE_PACKAGES, "firstfix_builder"]
    subprocess.run([venv / "bin/python", "-c", LOAD_ALL, *roots], check=True)
    if kind == "builder":
        subprocess.run([venv / "bin/python", "-c", LOAD_DASK], check=True)


def remove(packages: Path, unused: list[str]) -> None:
    for folder in [*(packages / part for part in unused), *packages.rglob("tests")]:
        if folder.is_dir():
            shutil.rmtree(folder)
    for stub in packages.rglob("*.pyi"):
        stub.unlink()


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
