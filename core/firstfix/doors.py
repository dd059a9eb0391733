"""The doors of the house: what other installed packages bring in, and whose it is where they are missing.

The house never imports these packages. Each names what it brings under an entry point group, and a door
gives all that came through it. ``PACKAGES`` lists those of this repository: what is asked for and not there
is named.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution, entry_points
from typing import Any

from .errors import pip_install

# (app: typer.Typer) -> None: adds its commands to ``firstfix``.
COMMANDS = "firstfix.commands"
# (app: fastapi.FastAPI) -> None: includes its routers in the service's app.
ROUTES = "firstfix.routes"
# A reader of a kind of map source: ``SourceReader`` of firstfix_builder.sources.reading.
SOURCES = "firstfix.sources"
# {name: (folder, seed, extent_m or None) -> line to print}: writers of worlds for ``firstfix world``.
WORLDS = "firstfix.worlds"


@dataclass(frozen=True)
class Package:
    """A package of this repository that may be left out.

    Attributes:
        name: of the distribution.
        folder: in the repository.
        commands, worlds: their names.
        routes: paths as FastAPI writes them.
    """

    name: str
    folder: str
    commands: tuple[str, ...] = ()
    routes: tuple[str, ...] = ()
    worlds: tuple[str, ...] = ()

    def is_installed(self) -> bool:
        """Whether this interpreter has the package."""
        try:
            distribution(self.name)
        except PackageNotFoundError:
            return False
        return True

    def remedy(self, what: str) -> str:
        """The words for somebody who asked for a thing of the package."""
        return f"{what} is in {self.name}, which is not installed: {pip_install(self.folder)}"


PACKAGES = (
    Package(
        "firstfix-console",
        "./plugins/console",
        commands=("export",),
        routes=(
            "/",
            "/console",
            "/console/{path:path}",
            "/answers/counts",
            "/answers/events",
            "/maps/{map_id}/versions/{version}/cloud",
            "/maps/{map_id}/versions/{version}/cloud/points",
            "/maps/{map_id}/versions/{version}/overlay",
            "/maps/{map_id}/versions/{version}/thumbnail",
            "/maps/{map_id}/versions/{version}/viewer-file",
            "/scan-report",
            "/viewer-formats",
        ),
    ),
    Package("firstfix-fleet", "./plugins/fleet", commands=("ros-gateway", "vda5050-gateway")),
    Package(
        "firstfix-lab",
        "./lab",
        commands=("dataset", "evaluate"),
        worlds=("campus", "city", "farm", "office"),
    ),
)


def absent() -> tuple[Package, ...]:
    """The packages of this repository that are not installed."""
    return tuple(package for package in PACKAGES if not package.is_installed())


def through(door: str) -> dict[str, Any]:
    """Things that installed packages bring through a door, by their entry points' names.

    Raises:
        ImportError: a package is damaged.
    """
    return {found.name: found.load() for found in sorted(entry_points(group=door), key=lambda one: one.name)}
