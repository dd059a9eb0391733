"""Models of kept queries."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from firstfix.catalog.query_samples import QuerySample

from .answer_models import Pose


class Truth(BaseModel):
    """Place where a scan was taken, as people have told."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {
                    "map_id": "hall",
                    "T_map_sensor": {"position": [12.3, -4.0, 1.0], "quaternion": [0.0, 0.0, 0.0, 1.0]},
                }
            ]
        },
    )
    map_id: str
    T_map_sensor: Pose | None = Field(description="null: the scan was not taken in this map")


class Sample(BaseModel):
    """A kept query."""

    sample_id: str
    time: str = Field(description="of the answer, UTC, ISO 8601")
    transport: str
    request_id: str
    trace_id: str
    map_id: str = Field(description="as in the request: one, several separated by commas, or empty")
    media_type: str
    content_encoding: str
    options: dict[str, str]
    answer: dict[str, Any] = Field(description="see `POST /localize`")
    body_bytes: int
    service_version: str
    truth: Truth | None = Field(description="null: nobody has told")

    @classmethod
    def of(cls, sample: QuerySample) -> Sample:
        """Returns the model of a sample."""
        return cls.model_validate({**asdict(sample), "truth": sample.truth or None})


class SamplePage(BaseModel):
    """A page of kept queries."""

    samples: list[Sample] = Field(description="newest first")
    next: str | None = Field(
        description="`after` of the next page, even if this page is short; null: this is the last page"
    )
