"""/samples: queries that the service has kept, with their answers, and where their scans were taken."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from firstfix.access.permissions import Scope
from firstfix.answer.localization import Verdict
from firstfix.answer.options import MAX_NUMBER
from firstfix.catalog.recorded_queries import QuerySample, QuerySamples
from firstfix.errors import InvalidOption, NotFound
from firstfix.ids import check_map_id
from firstfix.transform import from_quaternion

from ...auth.principal import Principal
from ...settings import Settings
from ...thread_pools import CHANGES, LISTS
from ..bodies.json_body import read_model
from ..edge import CallerDep, needs
from ..parts import SamplesDep
from ..response_budget import ResponseLeaseDep
from ..schema.answer_models import Pose
from ..schema.bodies import binary_answer, json_body
from ..schema.parameters import DEFAULT_LIMIT, After, Limit, SampleId

router = APIRouter(prefix="/samples", tags=["samples"])
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
    truth: ToldTruth | None = Field(description="null: nobody has told")

    @classmethod
    def of(cls, sample: QuerySample) -> Sample:
        """The model of a sample."""
        return cls.model_validate({**asdict(sample), "truth": sample.truth or None})


class SamplePage(BaseModel):
    """A page of kept queries."""

    samples: list[Sample] = Field(description="newest first")
    next: str | None = Field(
        description="`after` of the next page, even if this page is short; null: this is the last page"
    )
    share: float = Field(description="share of the queries without a pose that this service keeps; 0: none")


@router.get("")
@needs(Scope.BUILD, "localize")
@LISTS.route
def get_samples(
    request: Request,
    samples: SamplesDep,
    caller: CallerDep,
    map_id: Annotated[str | None, Query(description="only queries about this map")] = None,
    verdict: Annotated[Verdict | None, Query(description="only answers with this verdict")] = None,
    reason: Annotated[str | None, Query(max_length=64, description="only answers with this reason")] = None,
    limit: Limit = DEFAULT_LIMIT,
    after: After = None,
) -> SamplePage:
    """The kept queries about the caller's maps, newest first.

    `FIRSTFIX_SAMPLES_SHARE` says how many are kept.
    """
    if map_id is not None:
        caller.check_map(check_map_id(map_id))
    ids = [one for one in reversed(samples.ids()) if after is None or one < after]
    found: list[QuerySample] = []
    last = None
    for last in ids[:MAX_READ]:
        sample = samples.find(last)
        if sample is None or not _sees(caller, sample) or (map_id and not sample.is_about(map_id)):
            continue
        if verdict is not None and sample.answer["verdict"] != verdict.value:
            continue
        if reason is not None and reason not in sample.answer["reasons"]:
            continue
        found.append(sample)
        if len(found) == limit:
            break
    following = last if ids and last != ids[-1] else None
    settings: Settings = request.app.state.settings
    kept = [Sample.of(sample) for sample in found]
    return SamplePage(samples=kept, next=following, share=settings.samples_share)


@router.get("/{sample_id}")
@needs(Scope.BUILD)
@LISTS.route
def get_sample(sample_id: SampleId, samples: SamplesDep, caller: CallerDep) -> Sample:
    """One kept query, with its answer."""
    return Sample.of(_shown(samples, caller, sample_id))


@router.get(
    "/{sample_id}/body",
    response_class=Response,
    responses=binary_answer("*/*"),
)
@needs(Scope.BUILD, "localize")
@LISTS.route
def get_sample_body(
    sample_id: SampleId, samples: SamplesDep, caller: CallerDep, lease: ResponseLeaseDep
) -> Response:
    """The body of the query, as it came: `POST /localize` takes it again.

    Its content encoding is in the sample, not in this answer's header: the body stays as it is.
    """
    sample = _shown(samples, caller, sample_id)
    lease.take(sample.body_bytes)
    return Response(
        samples.body(sample_id),
        media_type="application/octet-stream",
        headers={"Cache-Control": "private, no-store", "X-Body-Type": _printable(sample.media_type)},
    )


@router.put("/{sample_id}/truth", openapi_extra=json_body(Truth))
@needs(Scope.BUILD)
async def put_truth(sample_id: SampleId, request: Request, samples: SamplesDep, caller: CallerDep) -> Sample:
    """Note where the scan was taken. The self-test of the map's next build asks the scan.

    `firstfix samples confirm` says so of queries whose answers were right.
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
    return await CHANGES.run(_set_truth, samples, caller, sample_id, truth.model_dump(mode="json"))


@router.delete("/{sample_id}/truth")
@needs(Scope.BUILD)
@CHANGES.route
def delete_truth(sample_id: SampleId, samples: SamplesDep, caller: CallerDep) -> Sample:
    """Forget where the scan was taken."""
    return _set_truth(samples, caller, sample_id, {})


@router.delete("/{sample_id}", status_code=204)
@needs(Scope.ADMIN)
@CHANGES.route
def delete_sample(sample_id: SampleId, samples: SamplesDep, caller: CallerDep) -> None:
    """Remove a kept query for good."""
    _shown(samples, caller, sample_id)
    samples.delete(sample_id)


def _printable(media_type: str) -> str:
    """The type as a header may hold it: a type that came over zenoh, or a record, may hold any text."""
    return "".join(char for char in media_type[:200] if " " <= char <= "~")


def _set_truth(samples: QuerySamples, caller: Principal, sample_id: str, truth: dict[str, Any]) -> Sample:
    _shown(samples, caller, sample_id)
    name = caller.name if caller.has_credential else ""  # an address is nobody in particular
    return Sample.of(samples.set_truth(sample_id, truth, name))


def _shown(samples: QuerySamples, caller: Principal, sample_id: str) -> QuerySample:
    """The sample, if the caller may see it.

    Raises:
        NotFound: there is none, or it is about a map that is hidden from the caller.
    """
    sample = samples.get(sample_id)
    if not _sees(caller, sample):
        raise NotFound(f"no sample {sample_id}")
    return sample


def _sees(caller: Principal, sample: QuerySample) -> bool:
    """Whether the caller sees every map that the query is about."""
    if caller.sees_every_map:
        return True
    return bool(sample.map_id) and all(caller.sees(map_id) for map_id in sample.maps)
