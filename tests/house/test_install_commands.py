"""Install lines of pages, notebooks and messages name folders of the checkout, and extras, that are there."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
import tomllib

from firstfix.errors import pip_install
from firstfix_cli.missing_package import missing_package
from tests.house.test_house import tracked_texts

REPO = Path(__file__).resolve().parents[2]
# A name in the place of a folder is looked up in an index, and none has firstfix.
NAMED = re.compile(
    r"\bpip[x3]? install\s[^\n#;&|`]*?(?<![\w./-])firstfix(-client)?(?=[\[\s'\"`,;)\\]|$)", re.M
)
WITH_EXTRA = re.compile(r"(?<![\w./-])firstfix(-client)?\[\w")
FOLDER = re.compile(r"(?<![\w/])(?P<folder>\.(/[\w/]+)?)\[(?P<extras>[a-z0-9,]+)\]")
# Extras name others of the same distribution, and packages that may be left out those that they need.
OWN_NAMES = (
    "pyproject.toml",
    "plugins/console/pyproject.toml",
    "plugins/fleet/pyproject.toml",
    "lab/pyproject.toml",
    "deploy/locks/",
)


def install_texts() -> list[tuple[str, str]]:
    here = Path(__file__).relative_to(REPO).as_posix()
    return [(name, text) for name, text in tracked_texts() if name != here and not name.startswith(OWN_NAMES)]


def test_nothing_is_said_to_be_in_an_index():
    found = [
        f"{name}: {match.group()}"
        for name, text in install_texts()
        for pattern in (NAMED, WITH_EXTRA)
        for match in pattern.finditer(text)
    ]
    assert not found, "say `pip install '.[EXTRA]'` in a checkout; messages say it with `errors.pip_install`"


@pytest.mark.parametrize(
    ("text", "seen"),
    [
        ("pip install firstfix", True),
        ("pip install 'firstfix[dds]'", True),
        ("uv pip install --quiet firstfix-client", True),
        ("needs rerun: `firstfix[rerun]`", True),
        ("pip install ./clients/python && ln -s clients/ros2 src/firstfix_ros", False),
        ("pip install '.[dds]'      # in a checkout of firstfix", False),
        ("pip install '/path/to/firstfix[dds]'", False),
        ("cd .../firstfix && pip install './clients/python[zenoh]'", False),
    ],
)
def test_a_name_in_an_index_is_seen(text: str, seen: bool):
    assert bool(NAMED.search(text) or WITH_EXTRA.search(text)) == seen


def test_every_extra_that_is_named_is_there():
    named = {
        (match["folder"], extra)
        for name, text in install_texts()
        for match in FOLDER.finditer(text)
        if "install" in text[max(0, match.start() - 200) : match.start()]
        for extra in match["extras"].split(",")
    }
    assert {("./plugins/fleet", "dds"), (".", "service"), ("./clients/python", "zenoh")} <= named
    for folder, extra in named:
        project = tomllib.loads((REPO / folder / "pyproject.toml").read_text())["project"]
        assert extra in project["optional-dependencies"], f"{folder}[{extra}]"


def test_messages_say_what_to_type_and_where(monkeypatch: pytest.MonkeyPatch):
    text = pip_install("./clients/python[zenoh]", ".[zenoh]")
    assert text == "pip install './clients/python[zenoh]' or '.[zenoh]' in the checkout"
    nameless = ModuleNotFoundError("No module named 'rosbags'", name="rosbags")
    assert missing_package(nameless).startswith(
        "the package rosbags is not installed: pip install '.[service]'"
    )
    monkeypatch.setattr(sys, "version_info", (3, 10, 13))
    assert missing_package(nameless).endswith("; both need Python 3.11 or newer")
    assert missing_package(ModuleNotFoundError("DDS needs it", name="cyclonedds")) == "DDS needs it"
