"""Removes files from an image that no running program needs, and checks that all modules still load.

    slim.py VENV service    also removes what only builds use: parts of SciPy, the sample worlds
    slim.py VENV builder

Run it with the system's Python while an image is made; it needs strip from binutils. It keeps the metadata
of the packages, so the bill of materials stays complete.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

# The service uses k-d trees, rotations and a minimizer of SciPy. These parts are not needed for them.
UNUSED_BY_SERVICE = ["firstfix_cli/sample_world"] + [
    f"scipy/{part}"
    for part in ("cluster", "datasets", "differentiate", "fftpack", "integrate", "interpolate", "io", "misc")
    + ("ndimage", "odr", "signal", "stats")
]
# The compiler of DDS types, with a second copy of the library.
UNUSED = ["cyclonedds/.libs"]
STRIPPED_FROM_BYTES = 500_000

# Imports every module of firstfix, and libraries that are imported late. This also writes their bytecode: the
# service's image has no other. Of the compiled modules `firstfix.native` imports the one for this processor:
# others may have instructions that it lacks. The
# sample world needs the builder.
LOAD_ALL = """
import importlib, pkgutil, sys
for root in sys.argv[1:]:
    package = importlib.import_module(root)
    for module in pkgutil.walk_packages(package.__path__, root + "."):
        if not module.name.startswith(("firstfix.native._", "firstfix_cli.sample_world")):
            importlib.import_module(module.name)
import jwt, nats, rosbags.rosbag1, uvicorn.loops.uvloop, zenoh
import opentelemetry.exporter.otlp.proto.http.trace_exporter, opentelemetry.sdk.trace.export
"""
LOAD_DASK = "import distributed.cli.dask_scheduler, distributed.cli.dask_worker, distributed.nanny"
SERVICE_PACKAGES = [
    "firstfix",
    "firstfix_service",
    "firstfix_client",
    "firstfix_cli",
    "firstfix_console",
    "firstfix_fleet",
]


def main(venv: Path, kind: str) -> None:
    packages = next(venv.glob("lib/python3.*/site-packages"))
    remove(packages, [*UNUSED, *(UNUSED_BY_SERVICE if kind == "service" else [])])
    for library in packages.rglob("*.so"):
        # auditwheel patched those in *.libs: strip would break them, and they have no debug symbols.
        if not library.parent.name.endswith(".libs") and library.stat().st_size >= STRIPPED_FROM_BYTES:
            subprocess.run(["strip", "--strip-unneeded", library], check=True)
    roots = SERVICE_PACKAGES + (["firstfix_builder"] if kind == "builder" else [])
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
