"""GET /answers/counts: how many queries of each map were answered lately, and how many were localized."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from typing import Annotated

from fastapi import APIRouter
from pydantic import BaseModel, Field

from firstfix.access.permissions import Scope
from firstfix_service.http_api.edge import CallerDep, needs
from firstfix_service.http_api.parts import part
from firstfix_service.localize.answer_counts import AnswerCounts, MapCounts
from firstfix_service.localize.recent_answers import RecentAnswers
from firstfix_service.thread_pools import METRICS

router = APIRouter(prefix="/answers", tags=["answers"])


class CountedAnswers(BaseModel):
    """Answers within a time."""

    answered: int
    localized: int = Field(description="of these")


class MapAnswerCounts(BaseModel):
    """Answers about one map."""

    map_id: str
    last_time: str = Field(description="of the last answer, UTC, ISO 8601")
    hour: CountedAnswers = Field(description="of the last hour, to within five minutes")
    day: CountedAnswers = Field(description="of the last 24 hours")

    @classmethod
    def of(cls, counts: MapCounts) -> MapAnswerCounts:
        """The model of a map's counts."""
        last = datetime.now(timezone.utc) - timedelta(seconds=counts.last_age_s)
        return cls(
            map_id=counts.map_id,
            last_time=last.isoformat(timespec="seconds"),
            hour=CountedAnswers(answered=counts.hour.answered, localized=counts.hour.localized),
            day=CountedAnswers(answered=counts.day.answered, localized=counts.day.localized),
        )


class AnswerCountsList(BaseModel):
    """Answers of one replica by map."""

    replica: str = Field(description="who counted: each replica counts its own answers since it started")
    maps: list[MapAnswerCounts] = Field(description="those that were asked, by their ids")


@router.get("/counts")
@needs(Scope.BUILD)
@METRICS.route
def get_answer_counts(
    counts: Annotated[AnswerCounts, part(AnswerCounts)],
    recent: Annotated[RecentAnswers, part(RecentAnswers)],
    caller: CallerDep,
) -> AnswerCountsList:
    """How many queries of the caller's maps this replica answered lately. Replays are not counted."""
    found = [MapAnswerCounts.of(one) for one in counts.of_maps() if caller.sees(one.map_id)]
    return AnswerCountsList(replica=recent.replica, maps=found)
