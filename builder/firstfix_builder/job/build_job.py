"""Inputs of one build, and the interface of functions that build a version from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from firstfix.catalog.manifest import Manifest


@dataclass(frozen=True)
class BuildJob:
    """The inputs of one build on this machine.

    Attributes:
        source: the map's file.
        trajectory: poses of the mapping run, or None.
        config: the build's configuration as JSON.
        work: folder for stages and the version.
        progress: called with a stage's name and its completed share, 0..1.
        cancelled: returns whether the build is cancelled.
        publish_provisional: called with the provisional version when it is ready; None: none is made.
    """

    source: Path
    trajectory: Path | None
    config: dict[str, Any]
    work: Path
    progress: Callable[[str, float], None]
    cancelled: Callable[[], bool]
    publish_provisional: Callable[[Built], None] | None = None


class Built(Protocol):
    """A version that is ready to be published, such as ``pipeline.BuiltVersion``."""

    @property
    def directory(self) -> Path:
        """Folder of the version's files."""

    @property
    def manifest(self) -> Manifest:
        """Manifest of the version."""


class BuildVersion(Protocol):
    """Builds a version from a job."""

    def __call__(self, job: BuildJob) -> Built:
        """Builds the version."""
