"""Picture of an evaluation: the map from above with true poses and answers, and scans over the map."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.bit_exact.sample import rows_by_chance
from firstfix.errors import pip_install
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix, transform_points

from .outcome import Outcome

MAX_MAP_POINTS = 400_000
MAX_SCAN_POINTS = 20_000
CLOSE_UPS, WRONG_CLOSE_UPS = 3, 2
ABOVE_SENSOR_M = 0.7  # higher points are ceilings, roofs and tree crowns, which would hide the rest
_PALE_TO_DARK = "YlGnBu"  # a pale floor, so that poses stand out
RIGHT, OFF, WRONG, NONE = "#1a9850", "#f28e2b", "#d73027", "#7f7f7f"


@dataclass(frozen=True)
class MapPicture:
    """Points and templates of a map version, in the map frame.

    Attributes:
        points: (n, 3) metres.
        templates: (m, 3) positions.
    """

    points: NDArray[np.float64]
    templates: NDArray[np.float64]

    @classmethod
    def load(cls, directory: Path) -> MapPicture:
        """Read them from a version's folder."""
        from firstfix.engine.config import ENGINE_FILE
        from firstfix.engine.index import MAP_FILE

        flat = json.loads((directory / ENGINE_FILE).read_text())["T_map_level"]
        T_map_level = np.asarray(flat, np.float64).reshape(4, 4)
        points = np.load(directory / MAP_FILE, mmap_mode="r")
        thinned = points[rows_by_chance(len(points), MAX_MAP_POINTS)]
        return cls(
            transform_points(T_map_level, thinned),
            transform_points(T_map_level, np.load(directory / "template_position_m.npy")),
        )

    def below_ceilings(self) -> NDArray[np.float64]:
        """(k, 3) points up to just above the sensor's height, lowest first."""
        from scipy.spatial import cKDTree

        _, nearest = cKDTree(self.templates[:, :2]).query(self.points[:, :2])
        shown = self.points[self.points[:, 2] < self.templates[nearest, 2] + ABOVE_SENSOR_M]
        return shown[np.argsort(shown[:, 2], kind="stable")]


def draw(
    path: Path,
    map_id: str,
    picture: MapPicture | None,
    outcomes: Sequence[Outcome],
    scans: Mapping[str, Scan],
    report: Mapping[str, Any],
) -> None:
    """Write the PNG.

    Args:
        picture: the map; None: draw only true poses and answers.
        scans: scans by the name of their outcome; a few of them are drawn over the map.
        report: result of ``evaluate.report_of``, for the title.

    Raises:
        ModuleNotFoundError: matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"--plot needs matplotlib: {pip_install('.[builder]')}", name=error.name
        ) from None
    chosen = _close_ups([o for o in outcomes if o.name in scans])
    left, right = 10.0, 5.0 if chosen else 0.0  # inches
    height = float(np.clip(left * _aspect(picture, outcomes), 0.7 * left, 1.4 * left)) + 1.5
    figure = Figure(figsize=(left + right, height), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        max(1, len(chosen)), 2 if chosen else 1, width_ratios=(2, 1)[: 1 + bool(chosen)]
    )
    _draw_overview(figure.add_subplot(grid[:, 0]), picture, outcomes)
    for row, outcome in enumerate(chosen):
        axes = figure.add_subplot(grid[row, 1])
        _draw_close_up(axes, picture, outcome, scans[outcome.name])
        if row == 0:
            axes.legend(loc="lower right", fontsize=7, markerscale=4)
    figure.suptitle(_title(map_id, report), fontsize=13)
    figure.savefig(path, metadata={"Software": None})


def _draw_overview(axes: Any, picture: MapPicture | None, outcomes: Sequence[Outcome]) -> None:
    if picture is not None:
        _scatter_heights(axes, picture.below_ceilings(), size=0.25)
        axes.scatter(*picture.templates[:, :2].T, s=2, c="black", alpha=0.25, lw=0, zorder=2)
        axes.plot([], [], ".", c="0.6", ms=4, label="template")
    arrow_m = _arrow_m(picture, outcomes)
    for outcome in outcomes:
        truth, answer = outcome.T_map_sensor, outcome.answer.T_map_sensor
        colour = _colour(outcome)
        if truth is not None:
            axes.plot(*truth[:2, 3], "o", ms=11, mfc="none", mec="black", mew=1.2, zorder=5)
            _heading(axes, truth, 1.3 * arrow_m, "black", 1.0)
        if answer is not None:
            marker, size = ("o", 6) if truth is not None else ("*", 14)
            axes.plot(*answer[:2, 3], marker, ms=size, c=colour, mec="white", zorder=6)
            _heading(axes, answer, arrow_m, colour, 2.0)
        elif truth is not None:
            axes.plot(*truth[:2, 3], "x", ms=8, c=colour, mew=2, zorder=6)
        if truth is not None and answer is not None:
            axes.plot(*np.stack([truth[:2, 3], answer[:2, 3]]).T, "-", c=colour, lw=1.5, zorder=4)
    for marker, colour, text in (
        ("o", "none", "truth (line: heading)"),
        ("o", RIGHT, "within 0.2 m and 5 deg"),
        ("o", OFF, "within 1 m and 10 deg"),
        ("o", WRONG, "localized, but wrong"),
        ("x", NONE, "not localized"),
        ("*", WRONG, "localized, but not in this map"),
    ):
        edge = "black" if colour == "none" else colour
        axes.plot([], [], marker, c=edge, mfc=colour, label=text, ls="none")
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.07), ncols=4, fontsize=8, frameon=False)


def _draw_close_up(axes: Any, picture: MapPicture | None, outcome: Outcome, scan: Scan) -> None:
    """Draw the scan at the answered pose, over a slice of the map at the sensor's height."""
    T_map_sensor = outcome.answer.T_map_sensor
    assert T_map_sensor is not None
    points = transform_points(T_map_sensor, scan.points[rows_by_chance(len(scan), MAX_SCAN_POINTS)])
    centre = T_map_sensor[:3, 3]
    reach = float(np.clip(np.percentile(np.abs(points[:, :2] - centre[:2]).max(axis=1), 75), 6, 25))
    if picture is not None:
        near = picture.points[(np.abs(picture.points[:, :2] - centre[:2]) < reach).all(axis=1)]
        walls = near[np.abs(near[:, 2] - centre[2]) < ABOVE_SENSOR_M]
        axes.scatter(*walls[:, :2].T, s=2.5, c="0.55", lw=0, label="map at the sensor's height")
    shown = points[np.abs(points[:, 2] - centre[2]) < ABOVE_SENSOR_M]
    axes.scatter(*shown[:, :2].T, s=1.0, c=_colour(outcome), lw=0, label="scan at the answered pose")
    if outcome.T_map_sensor is not None:
        truth = outcome.T_map_sensor
        axes.plot(*truth[:2, 3], "o", ms=9, mfc="none", mec="black", mew=1.2)
        _heading(axes, truth, reach / 6, "black", 1.2)
    axes.plot(*centre[:2], "o", ms=5, c=_colour(outcome), mec="white")
    axes.set_xlim(centre[0] - reach, centre[0] + reach)
    axes.set_ylim(centre[1] - reach, centre[1] + reach)
    axes.set_aspect("equal")
    error = "not in this map"
    if outcome.T_map_sensor is not None:
        error = f"{_length(outcome.error_m)}, {outcome.error_deg:.2f} deg off"
    axes.set_title(f"{Path(outcome.name).name}: {error}", fontsize=9)


def _close_ups(outcomes: Sequence[Outcome]) -> list[Outcome]:
    """Up to two false accepts, and right answers from the best to the worst."""
    accepted = sorted((o for o in outcomes if o.is_accepted), key=lambda o: o.error_m)
    wrong = [o for o in accepted if o.is_false_accept][-WRONG_CLOSE_UPS:]
    right = [o for o in accepted if not o.is_false_accept]
    places = np.unique(np.linspace(0, len(right) - 1, CLOSE_UPS - len(wrong)).round().astype(int))
    return [*(right[place] for place in places if right), *wrong]


def _scatter_heights(axes: Any, points: NDArray[np.float64], size: float) -> None:
    if len(points) == 0:
        return
    low, high = np.percentile(points[:, 2], [2, 98])
    drawn = axes.scatter(
        *points[:, :2].T, c=points[:, 2], s=size, cmap=_PALE_TO_DARK, vmin=low, vmax=high, lw=0, zorder=1
    )
    axes.figure.colorbar(drawn, ax=axes, label="z (m)", shrink=0.5, pad=0.01)


def _heading(axes: Any, T: Matrix, length_m: float, colour: str, width: float) -> None:
    start, end = T[:2, 3], T[:2, 3] + T[:2, 0] * length_m
    axes.plot([start[0], end[0]], [start[1], end[1]], "-", c=colour, lw=width, zorder=5)


def _arrow_m(picture: MapPicture | None, outcomes: Sequence[Outcome]) -> float:
    """An arrow length that is visible at this scale."""
    return max(1.0, float(_extent(picture, outcomes).max()) / 30)


def _aspect(picture: MapPicture | None, outcomes: Sequence[Outcome]) -> float:
    """Height divided by width."""
    width, height = _extent(picture, outcomes)
    return float((height + 1) / (width + 1))


def _extent(picture: MapPicture | None, outcomes: Sequence[Outcome]) -> NDArray[np.float64]:
    """(2,) metres along x and y; zeros if nothing is shown."""
    if picture is not None:
        shown = picture.points[:, :2]
    else:
        poses = [T for o in outcomes for T in (o.T_map_sensor, o.answer.T_map_sensor) if T is not None]
        shown = np.array([T[:2, 3] for T in poses]).reshape(-1, 2)
    return np.ptp(shown, axis=0) if len(shown) else np.zeros(2)


def _colour(outcome: Outcome) -> str:
    if not outcome.is_accepted:
        return NONE
    if outcome.is_false_accept:
        return WRONG
    return RIGHT if outcome.is_within(0.2) else OFF


def _title(map_id: str, report: Mapping[str, Any]) -> str:
    verdicts = ", ".join(f"{count} {name}" for name, count in report["verdicts"].items())
    success = ", ".join(f"{report[f'success_{m}m']:.0%} within {m} m" for m in ("0.05", "0.2", "1"))
    median = report["median_error_m"]
    middle = "" if median is None else f"; median {_length(median)}, {report['median_error_deg']:.2f} deg"
    return (
        f"{map_id}: {report['n']} scans, {verdicts}\n{success}{middle}; "
        f"{report['false_accept_rate']:.0%} false among localized"
    )


def _length(metres: float) -> str:
    return f"{metres * 100:.1f} cm" if metres < 1 else f"{metres:.1f} m"
