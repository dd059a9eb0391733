"""The query flow: a scan in, one answer out. Every stage is one named call."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

from ..answer.localization import Localization, Reason, Verdict
from ..answer.options import LocalizeOptions
from ..answer.quality import MAX_MARGIN
from ..errors import InvalidOption
from ..scan.any_scan import AnyScan
from ..scan.compact import CompactScan, ScanDescriptor
from ..scan.scan import Scan
from ..scan.sequence import ScanSequence
from ..transform import inverse
from .candidates import search
from .descriptor_only import Proposal, answer_unregistered, propose
from .hypotheses import Place, find_places, place_evidence
from .index import MapIndex
from .preprocess import preprocess
from .registration.covariance import pose_covariance
from .stopwatch import Stopwatch
from .verdict import Claim, judge

CONVINCING_INLIER_RATIO = 0.75  # with less, the other ways up are tried too, however probable the place is


class FindsPlaces(Protocol):
    """What ``localize_among`` needs of a map."""

    def claims(
        self,
        sequence: ScanSequence,
        options: LocalizeOptions,
        watch: Stopwatch,
        map_id: str = "",
        otherwise: bool = False,
    ) -> list[Claim] | None: ...

    def proposals(
        self, scan: ScanDescriptor, options: LocalizeOptions, watch: Stopwatch, map_id: str = ""
    ) -> list[Proposal]: ...


class Localizer:
    """Answers queries against one version. Thread-safe."""

    def __init__(self, index: MapIndex) -> None:
        self.index = index

    def localize(self, scan: AnyScan, options: LocalizeOptions | None = None) -> Localization:
        """The pose in the map where a scan, or the last of several, was taken; or why there is none."""
        return localize_among({"": self}, scan, options)

    def claims(
        self,
        sequence: ScanSequence,
        options: LocalizeOptions,
        watch: Stopwatch,
        map_id: str = "",
        otherwise: bool = False,
    ) -> list[Claim] | None:
        """The places of this map that may be it, best first; None where the scan has too few points.

        Args:
            otherwise: not with the up that is the likeliest, but with the others that the scan may have.
        """
        index, mounting = self.index, options.T_base_sensor
        with watch.stage("preprocess"):
            R_base_sensor = None if mounting is None else mounting[:3, :3]
            prepared = preprocess(sequence, options.gravity, index.config.preprocess, R_base_sensor)
            if prepared is None:
                return None
            scans = prepared.scans
            if otherwise:
                scans = prepared.levelled_otherwise(options.gravity, index.config.preprocess)
        with watch.stage("describe"):
            described = [one.described_by(index.cascade.descriptor) for one in scans]
        places: list[Place] = []
        for effort in (1,) if otherwise else _efforts(index, options):
            with watch.stage("search"):
                candidates = search(index, described, scans, options, effort)
            with watch.stage("register"):
                places = find_places(index, prepared, candidates, options.prior)
            if places and index.calibration.accepts(place_evidence(index.calibration, places)):
                break
        return [Claim(place, index, map_id) for place in places]

    def proposals(
        self, scan: ScanDescriptor, options: LocalizeOptions, watch: Stopwatch, map_id: str = ""
    ) -> list[Proposal]:
        """Where a scan may have been taken of which there is but the descriptor."""
        with watch.stage("search"):
            return propose(self.index, scan, options, map_id)


def _efforts(index: MapIndex, options: LocalizeOptions) -> Iterable[int]:
    """Most scans are easy; the others, one in ten, are worth a search several times as wide."""
    widened = index.config.search.widened
    return (1,) if widened == 1 or options.max_candidates is not None else (1, widened)


def localize_among(
    maps: Mapping[str, FindsPlaces], scan: AnyScan, options: LocalizeOptions | None = None
) -> Localization:
    """As ``Localizer.localize``, with the places of several maps competing on equal terms.

    Args:
        maps: by id. The answer's ``map_id`` says whose frame its pose is in.

    Raises:
        InvalidOption: a prior or a version with several maps: they are one map's.
        DescriptorMismatch: a descriptor alone that is not that of every map.
    """
    options, watch = options or LocalizeOptions(), Stopwatch()
    if len(maps) > 1 and (options.prior is not None or options.version is not None):
        raise InvalidOption("a prior and a version belong to one map: name it")
    if isinstance(scan, ScanDescriptor):
        each = [localizer.proposals(scan, options, watch, map_id) for map_id, localizer in maps.items()]
        return replace(answer_unregistered([one for of_map in each for one in of_map]), timings_ms=watch.ms)
    sequence = ScanSequence.single(scan) if isinstance(scan, (Scan, CompactScan)) else scan

    def found(otherwise: bool) -> list[list[Claim] | None]:
        return [one.claims(sequence, options, watch, map_id, otherwise) for map_id, one in maps.items()]

    claims = found(otherwise=False)
    if all(of_map is None for of_map in claims):
        return Localization(Verdict.REJECTED, (Reason.TOO_FEW_POINTS,), timings_ms=watch.ms)
    if not any(_explain_scan(of_map) for of_map in claims if of_map):
        more = found(otherwise=True)
        claims = [_distinct([*(one or ()), *(other or ())]) for one, other in zip(claims, more, strict=True)]
    with watch.stage("verify"):
        together = [claim for of_map in claims if of_map is not None for claim in of_map]
        answer = _verify(sorted(together, key=lambda claim: -claim.place.quality.support), options)
    return replace(answer, timings_ms=watch.ms)


def _explain_scan(claims: Sequence[Claim]) -> bool:
    """Whether the best of a map's claims would be accepted but for its rivals, and so well that the scan was
    levelled rightly.

    Levelled wrongly, up to two thirds of a scan may lie on surfaces of the map that nothing contradicts.
    """
    calibration = claims[0].index.calibration
    best = place_evidence(calibration, [claim.place for claim in claims])
    alone = replace(best, margin=MAX_MARGIN, tied=1)
    return best.quality.inlier_ratio >= CONVINCING_INLIER_RATIO and calibration.accepts(alone)


def _distinct(claims: Sequence[Claim]) -> list[Claim]:
    """The better one of two that are the same place of a map, best first."""
    kept: list[Claim] = []
    for claim in sorted(claims, key=lambda claim: -claim.place.quality.support):
        if not any(claim.place.is_same_as(known.place) for known in kept):
            kept.append(claim)
    return kept


def _verify(claims: list[Claim], options: LocalizeOptions) -> Localization:
    """The verdict on the places, and the pose where there is one."""
    judged = judge(claims, options.min_probability)
    if judged.verdict is not Verdict.LOCALIZED:
        return Localization(
            judged.verdict, judged.reasons, probability=judged.probability, hypotheses=judged.hypotheses
        )
    best, mounting = claims[0], options.T_base_sensor
    information, config = best.place.registration.information, best.index.config.registration
    return Localization(
        Verdict.LOCALIZED,
        T_map_sensor=best.T_map_sensor,
        T_map_base=None if mounting is None else best.T_map_sensor @ inverse(mounting),
        covariance=pose_covariance(information, best.index.T_map_level, config),
        probability=judged.probability,
        hypotheses=judged.hypotheses,
        map_id=best.map_id,
    )
