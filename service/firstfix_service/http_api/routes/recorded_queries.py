"""/recorded-queries: queries with their answers, as they came, and where their scans were taken."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from firstfix.access.permissions import Scope
from firstfix.answer.localization import Verdict
from firstfix.answer.options import MAX_NUMBER
from firstfix.catalog.recorded_queries import RecordedQueries, RecordedQuery
from firstfix.errors import InvalidOption, NotFound
from firstfix.ids import check_map_id
from firstfix.transform import from_quaternion

from ...auth.principal import Principal
from ...settings import Settings
from ...thread_pools import CHANGES, LISTS
from ..bodies.json_body import read_model
from ..edge import CallerDep, needs
from ..parts import RecordedQueriesDep
from ..response_budget import ResponseLeaseDep
from ..schema.answer_models import Pose
from ..schema.bodies import binary_answer, json_body
from ..schema.parameters import DEFAULT_LIMIT, After, Limit, QueryId

router = APIRouter(prefix="/recorded-queries", tags=["recorded-queries"])
MAX_READ = 2000  # records that one request reads


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


class ToldTruth(Truth):
    """Place where a scan was taken, and who has told."""

    told_by: str = Field("", description="name of the caller; empty: nobody can tell")
    told_at: str = Field("", description="UTC, ISO 8601")


class RecordedQueryDetails(BaseModel):
    """A recorded query."""

    query_id: str
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
    truth: ToldTruth | None = Field(description="null: nobody has told")

    @classmethod
    def of(cls, recorded: RecordedQuery) -> RecordedQueryDetails:
        """The model of a recorded query."""
        return cls.model_validate({**asdict(recorded), "truth": recorded.truth or None})


class RecordedQueryPage(BaseModel):
    """A page of recorded queries."""

    queries: list[RecordedQueryDetails] = Field(description="newest first")
    next: str | None = Field(
        description="`after` of the next page, even if this page is short; null: this is the last page"
    )
    share: float = Field(description="share of the queries without a pose that this service records; 0: none")


@router.get("")
@needs(Scope.BUILD, "localize")
@LISTS.route
def get_recorded_queries(
    request: Request,
    recorded_queries: RecordedQueriesDep,
    caller: CallerDep,
    map_id: Annotated[str | None, Query(description="only queries about this map")] = None,
    verdict: Annotated[Verdict | None, Query(description="only answers with this verdict")] = None,
    reason: Annotated[str | None, Query(max_length=64, description="only answers with this reason")] = None,
    limit: Limit = DEFAULT_LIMIT,
    after: After = None,
) -> RecordedQueryPage:
    """The recorded queries about the caller's maps, newest first.

    `FIRSTFIX_RECORDED_SHARE` says how many are recorded.
    """
    if map_id is not None:
        caller.check_map(check_map_id(map_id))
    ids = [one for one in reversed(recorded_queries.ids()) if after is None or one < after]
    found: list[RecordedQuery] = []
    last = None
    for last in ids[:MAX_READ]:
        recorded = recorded_queries.find(last)
        if recorded is None or not _sees(caller, recorded) or (map_id and not recorded.is_about(map_id)):
            continue
        if verdict is not None and recorded.answer["verdict"] != verdict.value:
            continue
        if reason is not None and reason not in recorded.answer["reasons"]:
            continue
        found.append(recorded)
        if len(found) == limit:
            break
    following = last if ids and last != ids[-1] else None
    settings: Settings = request.app.state.settings
    kept = [RecordedQueryDetails.of(recorded) for recorded in found]
    return RecordedQueryPage(queries=kept, next=following, share=settings.recorded_share)


@router.get("/{query_id}")
@needs(Scope.BUILD)
@LISTS.route
def get_recorded_query(
    query_id: QueryId, recorded_queries: RecordedQueriesDep, caller: CallerDep
) -> RecordedQueryDetails:
    """One recorded query, with its answer."""
    return RecordedQueryDetails.of(_shown(recorded_queries, caller, query_id))


@router.get(
    "/{query_id}/body",
    response_class=Response,
    responses=binary_answer("*/*"),
)
@needs(Scope.BUILD, "localize")
@LISTS.route
def get_recorded_body(
    query_id: QueryId, recorded_queries: RecordedQueriesDep, caller: CallerDep, lease: ResponseLeaseDep
) -> Response:
    """The body of the query, as it came: `POST /localize` takes it again.

    Its content encoding is in the record, not in this answer's header: the body stays as it is.
    """
    recorded = _shown(recorded_queries, caller, query_id)
    lease.take(recorded.body_bytes)
    return Response(
        recorded_queries.body(query_id),
        media_type="application/octet-stream",
        headers={"Cache-Control": "private, no-store", "X-Body-Type": _printable(recorded.media_type)},
    )


@router.put("/{query_id}/truth", openapi_extra=json_body(Truth))
@needs(Scope.BUILD)
async def put_truth(
    query_id: QueryId, request: Request, recorded_queries: RecordedQueriesDep, caller: CallerDep
) -> RecordedQueryDetails:
    """Note where the scan was taken. The self-test of the map's next build asks the scan.

    `firstfix recorded confirm` says so of queries whose answers were right.
    """
    truth = await read_model(request, Truth)
    caller.check_map(check_map_id(truth.map_id))
    if truth.T_map_sensor is not None:
        if not all(abs(metres) <= MAX_NUMBER for metres in truth.T_map_sensor.position):
            raise InvalidOption(f"T_map_sensor: a position is over {MAX_NUMBER:g} m from the map's origin")
        try:
            from_quaternion(truth.T_map_sensor.position, truth.T_map_sensor.quaternion)
        except ValueError as error:
            raise InvalidOption(f"T_map_sensor: {error}") from None
    return await CHANGES.run(_set_truth, recorded_queries, caller, query_id, truth.model_dump(mode="json"))


@router.delete("/{query_id}/truth")
@needs(Scope.BUILD)
@CHANGES.route
def delete_truth(
    query_id: QueryId, recorded_queries: RecordedQueriesDep, caller: CallerDep
) -> RecordedQueryDetails:
    """Forget where the scan was taken."""
    return _set_truth(recorded_queries, caller, query_id, {})


@router.delete("/{query_id}", status_code=204)
@needs(Scope.ADMIN)
@CHANGES.route
def delete_recorded_query(query_id: QueryId, recorded_queries: RecordedQueriesDep, caller: CallerDep) -> None:
    """Remove a recorded query for good."""
    _shown(recorded_queries, caller, query_id)
    recorded_queries.delete(query_id)


def _printable(media_type: str) -> str:
    """The type as a header may hold it: a type that came over zenoh, or a record, may hold any text."""
    return "".join(char for char in media_type[:200] if " " <= char <= "~")


def _set_truth(
    recorded_queries: RecordedQueries, caller: Principal, query_id: str, truth: dict[str, Any]
) -> RecordedQueryDetails:
    _shown(recorded_queries, caller, query_id)
    name = caller.name if caller.has_credential else ""  # an address is nobody in particular
    return RecordedQueryDetails.of(recorded_queries.set_truth(query_id, truth, name))


def _shown(recorded_queries: RecordedQueries, caller: Principal, query_id: str) -> RecordedQuery:
    """The recorded query, if the caller may see it.

    Raises:
        NotFound: there is none, or it is about a map that is hidden from the caller.
    """
    recorded = recorded_queries.get(query_id)
    if not _sees(caller, recorded):
        raise NotFound(f"no recorded query {query_id}")
    return recorded


def _sees(caller: Principal, recorded: RecordedQuery) -> bool:
    """Whether the caller sees every map that the query is about."""
    if caller.sees_every_map:
        return True
    return bool(recorded.map_id) and all(caller.sees(map_id) for map_id in recorded.maps)
