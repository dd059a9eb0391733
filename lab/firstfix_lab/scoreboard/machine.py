"""The machine and the versions of what decides figures."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = (
    "numpy",
    "scipy",
    "faiss-cpu",
    "open3d-cpu",
    "kiss-matcher",
    "map-closures",
    "rosbags",
    "cyclonedds",
    "eclipse-zenoh",
)


def machine() -> dict[str, str | int | float]:
    """Cores, processor, memory and system, without the name of the host."""
    memory_bytes = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    release = platform.freedesktop_os_release() if Path("/etc/os-release").exists() else {}
    return {
        "cpus": os.cpu_count() or 1,
        "processor": _processor(),
        "memory_gb": round(memory_bytes / 1e9, 1),
        "system": release.get("PRETTY_NAME", platform.system()),
        "load": round(os.getloadavg()[0], 2),
    }


def versions() -> dict[str, str]:
    """The versions of Python and of the packages that are installed."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def _processor() -> str:
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.machine())
