"""A chart as SVG: lines and points over two axes, on a white panel that print and dark pages show."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

Points = Sequence[tuple[float, float]]
WIDTH, HEIGHT = 640, 400
LEFT, RIGHT, TOP, BOTTOM = 64, 620, 40, 344
COLOURS = ("#0063a6", "#c8500a", "#2a7d2a", "#8a2be2", "#a8005c", "#5c5c00", "#008080", "#444444")
COLOURS += ("#7a4a12", "#5577ff", "#d43c3c")
DASHES = ("", "7 3", "2 3", "9 3 2 3")  # told apart in black and white, too
STEPS = (1, 2, 5)


@dataclass(frozen=True)
class Axis:
    """One axis.

    Attributes:
        low: least value.
        high: largest value.
        log: True if it is logarithmic.
    """

    label: str
    low: float
    high: float
    log: bool = False

    def place(self, value: float) -> float:
        """0..1 from the low to the high end; what lies beyond stands at the end."""
        clipped = min(max(value, self.low), self.high)
        if self.log:
            return math.log(clipped / self.low) / math.log(self.high / self.low)
        return (clipped - self.low) / (self.high - self.low)

    def ticks(self) -> list[float]:
        """The values that are written: 1, 2 and 5 of each decade, or five steps."""
        if not self.log:
            return [self.low + k * (self.high - self.low) / 5 for k in range(6)]
        first, last = math.floor(math.log10(self.low)), math.ceil(math.log10(self.high))
        steps = STEPS if last - first <= 3 else STEPS[:1]
        values = [step * 10.0**power for power in range(first, last + 1) for step in steps]
        return [value for value in values if self.low * 0.999 <= value <= self.high * 1.001]


def chart(title: str, x: Axis, y: Axis, lines: Mapping[str, Points], dots: Mapping[str, Points]) -> str:
    """The text of an SVG file.

    Args:
        lines: points of each line by its name.
        dots: points of each mark by its name.
    """
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
        f'font-family="sans-serif" font-size="12" fill="#222">',
        f"<title>{escape(title)}</title>",
        f'<rect width="{WIDTH}" height="{HEIGHT}" rx="6" fill="#fff"/>',
        f'<text x="{LEFT}" y="24" font-size="15" font-weight="bold">{escape(title)}</text>',
        *_axes(x, y),
    ]
    named = [*lines.items(), *dots.items()]
    right = [y.place(b) for _, points in named for a, b in points if x.place(a) > 0.5]
    is_high = sum(right) > 0.5 * len(right)  # the names stand where there is less to hide
    first = BOTTOM - 18 * len(named) if is_high else TOP + 18
    for number, (name, points) in enumerate(named):
        colour, dash = COLOURS[number % len(COLOURS)], DASHES[number % len(DASHES)]
        at = [(_across(x, a), _down(y, b)) for a, b in points]
        if number < len(lines):
            path = " ".join(f"{a:.1f},{b:.1f}" for a, b in at)
            parts.append(
                f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2" '
                f'stroke-dasharray="{dash}"/>'
            )
        parts += [f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3.5" fill="{colour}"/>' for a, b in at]
        row = first + 18 * number
        parts.append(f'<rect x="{RIGHT - 12}" y="{row - 9}" width="10" height="10" fill="{colour}"/>')
        parts.append(f'<text x="{RIGHT - 18}" y="{row}" text-anchor="end">{escape(name)}</text>')
    return "\n".join([*parts, "</svg>", ""])


def _axes(x: Axis, y: Axis) -> list[str]:
    parts = []
    for value in x.ticks():
        at = _across(x, value)
        parts.append(f'<path d="M{at:.1f} {TOP}V{BOTTOM}" stroke="#ddd"/>')
        parts.append(f'<text x="{at:.1f}" y="{BOTTOM + 16}" text-anchor="middle">{value:g}</text>')
    for value in y.ticks():
        at = _down(y, value)
        parts.append(f'<path d="M{LEFT} {at:.1f}H{RIGHT}" stroke="#ddd"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{at + 4:.1f}" text-anchor="end">{value:g}</text>')
    middle, centre = (LEFT + RIGHT) / 2, (TOP + BOTTOM) / 2
    parts.append(f'<path d="M{LEFT} {TOP}V{BOTTOM}H{RIGHT}" fill="none" stroke="#222"/>')
    parts.append(f'<text x="{middle}" y="{HEIGHT - 14}" text-anchor="middle">{escape(x.label)}</text>')
    parts.append(
        f'<text transform="translate(16 {centre}) rotate(-90)" text-anchor="middle">{escape(y.label)}</text>'
    )
    return parts


def _across(x: Axis, value: float) -> float:
    return LEFT + x.place(value) * (RIGHT - LEFT)


def _down(y: Axis, value: float) -> float:
    return BOTTOM - y.place(value) * (BOTTOM - TOP)
