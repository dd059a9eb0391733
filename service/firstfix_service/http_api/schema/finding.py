"""Schema of a finding: what is wrong or noteworthy with a scan or a map."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, Field


class Finding(BaseModel):
    """What is wrong or noteworthy with a scan or a map, and what helps."""

    code: str = Field(description="stable name, for programs")
    severity: Literal["error", "warning", "info"]
    text: str = Field(description="what was found, with its numbers")
    numbers: dict[str, float] = Field({}, description="what was measured, by name with unit")
    remedy: str = Field("", description="what helps")
    doc: str = Field("", description="page of the documents that tells more")
