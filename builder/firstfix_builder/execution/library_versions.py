"""Versions of the libraries that decide the results of stages: a stage of another version is not reused."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version

# Distributions that have a package of another name; the first one that is installed counts.
_DISTRIBUTIONS = {
    "faiss": ("faiss-cpu", "faiss-gpu", "faiss"),
    "lzf": ("python-neo-lzf",),
    "open3d": ("open3d-cpu", "open3d"),
}
_EVERYWHERE = ("numpy", "scipy")
_READERS = ("laspy", "lazrs", "lzf", "pye57", "trimesh", "zstandard")
_ENGINE = ("faiss", "open3d")  # of stages that ask an index with simulated scans
# Of each stage, besides those of all stages. Bags become folders of scans before a build: what reads them
# decides no stage.
_OF_STAGE: Mapping[str, tuple[str, ...]] = {
    "read_map": (*_READERS, *_ENGINE),  # sessions are aligned by an engine
    "reconstruct_mesh": ("open3d",),
    "sample_viewpoints": ("open3d",),
    "fit_engine": (),
    "make_templates": ("open3d",),
    "cluster": (),
    "learn_keys": ("open3d",),
    "carve_free_space": ("open3d",),
    "build_index": (*_ENGINE, "pillow"),  # with a picture
    "draw_cloud": (),
    "self_test": (*_READERS, *_ENGINE, "pillow"),
}


def libraries_of(stage: str) -> dict[str, str]:
    """The versions of the libraries that decide the result of a stage.

    Args:
        stage: its name. One that no build has is decided by all libraries that make an index.
    """
    names = {*_EVERYWHERE, *_OF_STAGE.get(stage, _ENGINE)}
    return {name: version_of(name) for name in sorted(names)}


@cache
def version_of(library: str) -> str:
    """The installed version, ``none`` without one. By its metadata: an import may take seconds."""
    for name in _DISTRIBUTIONS.get(library, (library,)):
        with suppress(PackageNotFoundError):
            return version(name)
    return "none"
