"""Things that come through the doors, and what is said of a package that is not installed."""

from __future__ import annotations

from importlib.metadata import distribution

import pytest
import tomllib
from fastapi.testclient import TestClient
from typer.testing import CliRunner

from firstfix import doors
from firstfix.doors import PACKAGES, Package
from firstfix_cli import main as command_line
from firstfix_service.app import create_app
from firstfix_service.http_api.routes.absent import absent_routes
from firstfix_service.settings import Settings
from tests.house.test_house import REPO

LACKING = Package("firstfix-nothing", "./plugins/nothing", ("fly",), ("/wings", "/wings/{name}"), ("sky",))


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
def test_every_package_has_its_folder_and_its_tests(package: Package):
    project = tomllib.loads((REPO / package.folder / "pyproject.toml").read_text())["project"]
    assert project["name"] == package.name
    assert set(project["entry-points"]) <= {doors.COMMANDS, doors.ROUTES, doors.SOURCES, doors.WORLDS}
    assert (REPO / package.folder / "README.md").is_file()
    assert list((REPO / package.folder / "tests").rglob("test_*.py"))


@pytest.mark.skipif(len(doors.absent()) > 0, reason="a package is left out")
def test_the_table_names_all_that_the_packages_bring():
    paths = {
        path for path in create_app(Settings(store="memory://")).openapi()["paths"] if "console" not in path
    }
    for package in PACKAGES:
        assert distribution(package.name).entry_points
        assert set(package.commands) <= {command.name for command in command_line.app.registered_commands} | {
            command.callback.__name__ for command in command_line.app.registered_commands if command.callback
        }
        assert {path for path in package.routes if path != "/" and "console" not in path} <= paths


def test_a_route_of_a_package_that_is_not_installed_names_it():
    app = create_app(Settings(store="memory://"))
    app.include_router(absent_routes(LACKING))
    answer = TestClient(app).get("/wings/left")
    assert answer.status_code == 404
    assert (
        "firstfix-nothing, which is not installed: pip install './plugins/nothing'" in answer.json()["detail"]
    )


def test_a_command_of_a_package_that_is_not_installed_names_it(monkeypatch: pytest.MonkeyPatch):
    app = command_line.typer.Typer()
    monkeypatch.setattr(command_line, "app", app)
    app.command("stay")(lambda: None)
    command_line._refuse("fly", LACKING.remedy("firstfix fly"))
    done = CliRunner().invoke(app, ["fly", "--high", "5"])
    assert str(done.exception).startswith(
        "firstfix fly is in firstfix-nothing, which is not installed: pip install"
    )
