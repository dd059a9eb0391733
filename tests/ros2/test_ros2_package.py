"""The files of the ament package agree with one another."""

from __future__ import annotations

import ast
import py_compile
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from firstfix.answer.free_direction import FreeDirection, Motion
from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.errors import InvalidOption
from firstfix.findings import scan_kinds
from firstfix_ros.messages.diagnostic_array import ERROR, OK, WARN
from firstfix_ros.parameters import Parameters
from firstfix_ros.robot.status import State, Status, diagnosis_of
from firstfix_ros.robot.watch import Health

PACKAGE = Path(__file__).resolve().parents[2] / "clients" / "ros2"


def test_setup_names_every_room():
    rooms = {path.parent.name for path in (PACKAGE / "firstfix_ros").glob("*/__init__.py")}
    assert all(f"{{NAME}}.{room}" in (PACKAGE / "setup.py").read_text() for room in rooms)


def test_the_files_that_setup_names_are_there():
    for node in ast.walk(ast.parse((PACKAGE / "setup.py").read_text())):
        if isinstance(node, ast.Constant) and str(node.value).startswith(("config/", "launch/")):
            assert list(PACKAGE.glob(node.value))
    assert (PACKAGE / "resource" / "firstfix_ros").is_file()


def imports(path: Path) -> set[str]:
    """The packages of ROS and others that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level == 0:
            found.add((node.module or "").partition(".")[0])
        elif isinstance(node, ast.Import):
            found |= {one.name.partition(".")[0] for one in node.names}
    return found - sys.stdlib_module_names - {"firstfix", "firstfix_client"}


def test_the_manifest_names_what_is_imported():
    manifest = ElementTree.parse(PACKAGE / "package.xml").getroot()
    depends = {element.text for element in manifest.findall("exec_depend")}
    files = [*(PACKAGE / "firstfix_ros").rglob("*.py"), *(PACKAGE / "launch").glob("*.py")]
    imported = {"python3-numpy" if name == "numpy" else name for path in files for name in imports(path)}
    assert imported <= depends
    assert depends - imported == {"launch_xml"}
    assert manifest.findtext("name") == "firstfix_ros"
    assert manifest.findtext("export/build_type") == "ament_python"


def constant(path: Path, name: str) -> Any:
    """The keys of a mapping that a file has as a constant."""
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Dict):
            (target,) = node.targets
            if isinstance(target, ast.Name) and target.id == name:
                return [ast.literal_eval(key) for key in node.value.keys if key is not None]
    raise AssertionError(name)


def test_launch_files_give_arguments_that_there_are():
    first = PACKAGE / "launch" / "first_fix.launch.py"
    parameters = constant(first, "PARAMETERS")
    assert set(parameters) - {"use_sim_time"} <= {one.name for one in Parameters.declarations()}
    known = {"params", "namespace", *constant(first, "TOPICS"), *parameters}
    others = sorted((PACKAGE / "launch").glob("*.launch.xml"))
    assert [one.name.partition(".")[0] for one in others] == ["autoware", "glim", "mola", "nav2"]
    for path in others:
        launch = ElementTree.parse(path).getroot()
        assert {one.attrib["name"] for one in launch.findall("arg")} <= known, path
        (included,) = launch.findall("include")
        assert included.attrib["file"].endswith(f"/launch/{first.name}")


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: path.name)
def test_every_file_compiles(path, tmp_path):
    py_compile.compile(str(path), cfile=str(tmp_path / "compiled"), doraise=True)


def test_the_sample_parameters_are_the_defaults():
    sample = yaml.safe_load((PACKAGE / "config" / "first_fix.yaml").read_text())
    values = sample["/**"]["ros__parameters"]
    assert values == {one.name: one.default for one in Parameters.declarations()} | {"map_id": "hall"}
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
        {"localizer": "here"},
        {"localizer": "local"},
        {"version_folder": "/maps/hall"},
        {"localizer": "local", "version_folder": "/maps/hall", "zenoh": "tcp/localhost:7447"},
    ],
)
def test_parameters_that_cannot_be(wrong):
    with pytest.raises(InvalidOption):
        Parameters.checked({"map_id": "hall", **wrong})


def test_diagnoses():
    localized = Localization(
        Verdict.LOCALIZED, (), np.eye(4), None, np.eye(6), 0.99, map_id="hall", map_version="ab"
    )
    assert diagnosis_of(Status()).level == OK
    assert diagnosis_of(Status()).name == "first_fix: pose in the map"
    without_odometry = diagnosis_of(Status(), missing_tf="odom -> base_link")
    assert (without_odometry.level, without_odometry.values["missing_tf"]) == (OK, "odom -> base_link")
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
