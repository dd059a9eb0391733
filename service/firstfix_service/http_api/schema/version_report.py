"""The report of a version: results of its self-test, and what its build kept of earlier versions."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, Field

from .api_models import MapFinding


class Rebuilt(BaseModel):
    """The part of earlier versions that a build kept, because little of the map had changed."""

    base: str = Field(description="version of the map that was compared")
    changed: int = Field(description="number of templates that differ from the base's")
    gone: int = Field(description="number of the base's templates that are no more")
    keys_of: str = Field(description="version that learned the keys")
    calibration_of: str | None = Field(description="version of the calibration; null: taught anew")


class VersionReport(BaseModel):
    """Results of the build's self-test."""

    map_id: str
    version: str
    counts: dict[str, int] = Field(description="numbers of templates, map points and so on")
    sensor: dict[str, Any] = Field(description="sensor for which the templates were simulated")
    bounds: list[list[float]] = Field(description="lowest and highest local coordinates, metres")
    self_test: dict[str, Any] = Field(
        description="success, false accepts, `reliability` of the probabilities, and `localizability`: where "
        "in the map a robot can find itself. A cell that is known and not said has what `helps` there: "
        "`second_scan`, `prior`, `other_height` or `drive_through`. With the poses of the mapping run, "
        "`mapped` and each cell's `never_seen` and `in_part` say which places it saw from a door or from "
        "afar alone"
    )
    findings: list[MapFinding] = Field(
        [], description="what is wrong or noteworthy with the map, and what helps"
    )
    rebuilt: Rebuilt | None = Field(
        None, description="what was kept of earlier versions; null: nothing, it was built from nothing"
    )
    pictures: list[str] = Field(description="names of the pictures of this version")
