"""The files of the ament package agree with one another."""

from __future__ import annotations

import ast
import py_compile
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from firstfix.answer.free_direction import FreeDirection, Motion
from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.errors import InvalidOption
from firstfix.findings import scan_kinds
from firstfix_ros.messages.diagnostic_array import ERROR, OK, WARN
from firstfix_ros.robot.status import State, Status, diagnosis_of
from firstfix_ros.robot.watch import Health

PACKAGE = Path(__file__).resolve().parents[2] / "clients" / "ros2"


def test_setup_names_every_room():
    rooms = {path.parent.name for path in (PACKAGE / "firstfix_ros").glob("*/__init__.py")}
    assert all(f"{{NAME}}.{room}" in (PACKAGE / "setup.py").read_text() for room in rooms)


def test_the_files_that_setup_names_are_there():
    for node in ast.walk(ast.parse((PACKAGE / "setup.py").read_text())):
        if isinstance(node, ast.Constant) and str(node.value).startswith(("config/", "launch/")):
            assert (PACKAGE / node.value).is_file()
    assert (PACKAGE / "resource" / "firstfix_ros").is_file()


def test_the_manifest_names_what_the_node_imports():
    manifest = ElementTree.parse(PACKAGE / "package.xml").getroot()
    depends = {element.text for element in manifest.findall("exec_depend")}
    imported = {
        (node.module or "").partition(".")[0]
        for node in ast.walk(ast.parse((PACKAGE / "firstfix_ros" / "node.py").read_text()))
        if isinstance(node, ast.ImportFrom) and node.level == 0
    }
    messages = {name for name in imported if name.endswith(("_msgs", "_srvs"))}
    assert messages <= depends
    assert {"rclpy", "tf2_msgs"} <= depends
    assert manifest.findtext("name") == "firstfix_ros"
    assert manifest.findtext("export/build_type") == "ament_python"


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: path.name)
def test_every_file_compiles(path, tmp_path):
    py_compile.compile(str(path), cfile=str(tmp_path / "compiled"), doraise=True)


def test_the_sample_parameters_are_the_defaults():
    from firstfix_ros.parameters import Parameters

    sample = yaml.safe_load((PACKAGE / "config" / "first_fix.yaml").read_text())
    values = sample["first_fix"]["ros__parameters"]
    assert values == {**Parameters.defaults(), "map_id": "hall"}
    assert Parameters.checked(values).config().base_frame == "base_link"


@pytest.mark.parametrize(
    "wrong",
    [
        {"map_id": ""},
        {"map_id": "a/b"},
        {"map_frame": ""},
        {"timeout_s": 0.0},
        {"retry_s": -1.0},
        {"watch_s": -1.0},
    ],
)
def test_parameters_that_cannot_be(wrong):
    from firstfix_ros.parameters import Parameters

    with pytest.raises(InvalidOption):
        Parameters.checked({"map_id": "hall", **wrong})


def test_diagnoses():
    localized = Localization(
        Verdict.LOCALIZED, (), np.eye(4), None, np.eye(6), 0.99, map_id="hall", map_version="ab"
    )
    assert diagnosis_of(Status()).level == OK
    failed = diagnosis_of(Status(State.FAILED, 3, None, "nobody is there"))
    assert (failed.level, failed.message) == (ERROR, "failed: nobody is there")
    rejected = Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,))
    refused = diagnosis_of(Status(State.NOT_LOCALIZED, 1, rejected))
    assert (refused.level, refused.values["reasons"]) == (WARN, "low_inlier_ratio")
    cause = scan_kinds.MIRRORED.found({"inlier_ratio": 0.97, "inlier_ratio_as_sent": 0.71}, axis="y")
    rejected = Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,), findings=(cause,))
    said = diagnosis_of(Status(State.NOT_LOCALIZED, 1, rejected))
    assert said.message.endswith("The scan fits when mirrored in y (inliers 0.97 against 0.71).")
    assert (said.values["findings"], said.values["remedy"]) == ("mirrored", cause.remedy)
    found = diagnosis_of(Status(State.LOCALIZED, 2, localized, took_s=0.25))
    assert found.level == OK
    assert [found.values[key] for key in ("map_id", "probability", "took_s")] == ["hall", "0.990", "0.250"]
    assert found.values["degenerate"] == ""
    corridor = replace(
        localized,
        degenerate=(
            FreeDirection(Motion.TRANSLATION, np.array([0.6, 0.8, 0.0]), 1.3),
            FreeDirection(Motion.ROTATION, np.array([0.0, 0.0, 1.0]), np.radians(5)),
        ),
    )
    assert diagnosis_of(Status(State.LOCALIZED, 2, corridor)).values["degenerate"] == (
        "translation (0.60, 0.80, 0.00) by 1.30 m, rotation (0.00, 0.00, 1.00) by 5.0 deg"
    )
    astray = diagnosis_of(Status(State.LOCALIZED, 1, localized, health=Health.ASTRAY))
    assert (astray.level, astray.values["own_localization"]) == (ERROR, "astray")
