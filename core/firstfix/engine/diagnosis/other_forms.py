"""Other forms of a scan that was not localized: mirrored, scaled, with other columns, without a wrong option.

Each form is asked through the ordinary engine, as the first search asks a scan. Where one would be accepted,
the finding names it. A mirror in x is one in y and a half turn, so two mirrors are all; and axes that are
only turned need no form, because the search finds any up.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...answer.options import LocalizeOptions
from ...findings import scan_kinds
from ...findings.finding import Finding
from ...scan.scan import Scan
from ..registered_candidate import RegisteredCandidate

BETTER = 0.1  # share of the scan that lies on the map, above that of the scan as it was sent
USUAL_SCALES = {0.3048: "feet", 1 / 1.1: "", 1.1: "", 0.95: "", 1.05: "", 0.1: "decimetres", 0.0254: "inches"}
MIN_SCALE, MAX_SCALE = 0.01, 100.0  # by the height above the floor
_SAME_SCALE = 0.03
_SCALE_TEXT = ", as from {}"
_FITS_TEXT = "with them the scan fits (inliers {inlier_ratio:.2f} against {inlier_ratio_as_sent:.2f})"
_MAX_TURN = 2 * np.pi + 0.01
_DEGREES = 360.0

Numbers = Mapping[str, float]
ChangePoints = Callable[[NDArray[np.float32]], NDArray[np.float32]]


@dataclass(frozen=True)
class OtherForm:
    """One form in which a query is asked again.

    Attributes:
        change: makes this form of the scan, or of a part of its points.
        options: options in this form.
        finding: makes the finding from the best place, and the numbers of both forms.
    """

    change: Callable[[Scan], Scan]
    options: LocalizeOptions
    finding: Callable[[RegisteredCandidate, Numbers], Finding]


def other_forms(
    scan: Scan, options: LocalizeOptions, height_m: float | None, usual_height_m: float
) -> Iterator[OtherForm]:
    """The forms, likeliest first.

    Args:
        scan: as it was sent.
        height_m: of the sensor above the floor, as the scan shows it; None: not known.
        usual_height_m: of the map's own sensor above the floor.
    """
    yield from _without_options(options)
    free = replace(options, prior=None, twist=None)  # the forms below have no times of their points
    yield from _of_columns(scan, free)
    for axis, name in ((1, "y"), (2, "z")):
        mirror = np.ones(3, np.float32)
        mirror[axis] = -1
        yield _of_points(_multiplied(mirror), free, scan_kinds.MIRRORED.found, axis=name)
    for scale, unit in scales(height_m, usual_height_m):
        yield _scaled(free, scale, unit)


def scales(height_m: float | None, usual_height_m: float) -> Iterator[tuple[float, str]]:
    """Factors to try, with the unit that each is of, or "": by the sensor's height, then usual ones."""
    tried = [1.0]
    by_height = 1.0
    if height_m is not None and height_m > 0 and usual_height_m > 0:  # a sensor may stand on the floor
        by_height = usual_height_m / height_m
    near = [one for one in USUAL_SCALES.items() if abs(one[0] - by_height) < _SAME_SCALE * by_height]
    for factor, unit in [*(near or [(by_height, "")]), *USUAL_SCALES.items()]:
        is_new = all(abs(factor / other - 1) > _SAME_SCALE for other in tried)
        if is_new and MIN_SCALE < factor < MAX_SCALE:
            tried.append(factor)
            yield factor, unit


def from_polar(points: NDArray[np.float32]) -> NDArray[np.float32] | None:
    """Points of (n, 3) ranges, azimuths and elevations; None: the numbers cannot be such."""
    if not len(points) or float(points[:, 0].min()) < 0:
        return None
    # in float64, whose rounded results are the same on nearly every processor
    range_m, azimuth, elevation = points.T.astype(np.float64)
    spans = float(np.abs(azimuth).max()), float(np.abs(elevation).max())
    if spans[0] > _DEGREES or spans[1] > 90:
        return None
    if spans[0] > _MAX_TURN or spans[1] > np.pi / 2 + 0.01:
        azimuth, elevation = np.radians(azimuth), np.radians(elevation)
    level_m = range_m * np.cos(elevation)
    return np.column_stack(
        [level_m * np.cos(azimuth), level_m * np.sin(azimuth), range_m * np.sin(elevation)]
    ).astype(np.float32)


def _of_columns(scan: Scan, options: LocalizeOptions) -> Iterator[OtherForm]:
    if scan.intensity is not None and float(np.ptp(scan.intensity)) > 0:
        yield OtherForm(_shifted, options, lambda _, numbers: _columns_shifted(numbers))
    if from_polar(scan.points) is not None:
        yield _of_points(_unrolled, options, scan_kinds.POLAR.found)


def _unrolled(points: NDArray[np.float32]) -> NDArray[np.float32]:
    found = from_polar(points)
    return points if found is None else found


def _shifted(scan: Scan) -> Scan:
    assert scan.intensity is not None
    return Scan.from_points(np.column_stack([scan.points[:, 1:], scan.intensity]))


def _columns_shifted(numbers: Numbers) -> Finding:
    return scan_kinds.COLUMNS_SHIFTED.found(numbers, evidence=_FITS_TEXT.format(**numbers))


def _as_sent(scan: Scan) -> Scan:
    return scan


def _without_options(options: LocalizeOptions) -> Iterator[OtherForm]:
    gravity, prior = options.gravity, options.prior
    if gravity is not None:

        def by_gravity(best: RegisteredCandidate, numbers: Numbers) -> Finding:
            down = best.T_map_sensor[:3, :3].T @ [0.0, 0.0, -1.0]
            off_deg = float(np.degrees(np.arccos(np.clip(down @ gravity, -1, 1))))
            kind = scan_kinds.GRAVITY_SIGN if off_deg > 135 else scan_kinds.GRAVITY_WRONG
            return kind.found({**numbers, "off_deg": off_deg})

        yield OtherForm(_as_sent, replace(options, gravity=-gravity), by_gravity)
        yield OtherForm(_as_sent, replace(options, gravity=None), by_gravity)
    if prior is not None:

        def by_prior(best: RegisteredCandidate, numbers: Numbers) -> Finding:
            off_m = float(np.linalg.norm(best.T_map_sensor[:3, 3] - prior.position_m))
            return scan_kinds.PRIOR_WRONG.found({**numbers, "distance_m": off_m})

        yield OtherForm(_as_sent, replace(options, prior=None), by_prior)


def _scaled(options: LocalizeOptions, scale: float, unit: str) -> OtherForm:
    def found(numbers: Numbers, **words: str) -> Finding:
        return scan_kinds.SCALED.found({**numbers, "scale": scale}, **words)

    text = _SCALE_TEXT.format(unit) if unit else ""
    return _of_points(_multiplied(np.float32(scale)), options, found, unit=text)


def _multiplied(factor: np.float32 | NDArray[np.float32]) -> ChangePoints:
    return lambda points: points * factor


def _of_points(
    change: ChangePoints, options: LocalizeOptions, found: Callable[..., Finding], **words: str
) -> OtherForm:
    def changed(scan: Scan) -> Scan:
        return Scan.from_points(np.ascontiguousarray(change(scan.points), np.float32))

    return OtherForm(changed, options, lambda _, numbers: found(numbers, **words))
