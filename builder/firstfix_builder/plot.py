"""A plot of a plane, as PNG: marks, lines and an image in a frame with ticks, a title and a legend.

A picture must cost less than what it shows: a library for plots takes a second to import and draw three.
No date and no tool's name go into the file: equal input gives equal bytes.
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Colour = tuple[int, int, int]
BLUE, ORANGE, GREEN, RED = (31, 119, 180), (255, 127, 14), (44, 160, 44), (214, 39, 40)
PURPLE, GREY, BLACK, WHITE = (148, 103, 189), (178, 178, 178), (0, 0, 0), (255, 255, 255)
DISC, SQUARE, CROSS = "disc", "square", "cross"  # shapes of marks

_LEFT, _RIGHT, _TOP, _BOTTOM, _ROW = 72, 18, 34, 52, 20  # pixels around the plane, and of a row of the legend
_TICK, _TEXT, _SMALL = 5, 14, 12  # pixels: a tick's length, sizes of letters
_FINER = 8  # samples of a pixel along each axis, at the rim of a mark
_MIN_SIDE = 160  # pixels of the plane: a narrower one has no room for its ticks
_STEPS = (1, 2, 5, 10)


class Plot:
    """A plane with equal units along both axes.

    Args:
        extent: west, east, south and north end.
        pixel: units that one pixel shows.
    """

    def __init__(self, extent: tuple[float, float, float, float], pixel: float) -> None:
        west, east, south, north = extent
        self._pixel = pixel
        self._size = (
            max(_MIN_SIDE, round((east - west) / pixel)),
            max(_MIN_SIDE, round((north - south) / pixel)),
        )
        self._west, self._north = west, south + self._size[1] * pixel
        self._plane = Image.new("RGB", self._size, WHITE)
        self._draw = ImageDraw.Draw(self._plane, "RGBA")
        self._legend: list[tuple[str, Colour, str]] = []

    def image(self, colour: NDArray[np.generic], opacity: NDArray[np.float64]) -> None:
        """Lay an image over the plane, a pixel for each of its own; its first row is the southern one.

        Args:
            colour: (rows, columns, 3) 0..255, or one for all pixels.
            opacity: (rows, columns) 0..1.
        """
        shown = 255 + (np.asarray(colour, np.float64) - 255) * opacity[..., None]
        rows = np.ascontiguousarray(np.rint(shown[::-1]).astype(np.uint8))
        self._plane.paste(Image.fromarray(rows), (0, self._size[1] - len(rows)))

    def marks(
        self,
        places: NDArray[np.floating],
        colour: Colour,
        radius: float,
        *,
        shape: str = DISC,
        opacity: float = 1.0,
        label: str = "",
    ) -> None:
        """Draw a mark at each of (n, 2) or more columns of places.

        Args:
            radius: in pixels.
            label: of the legend; empty: it has none.
        """
        stamp = _stamp(shape, radius, opacity)
        half = stamp.width // 2
        for x, y in np.rint(self._pixels(places)).astype(int).tolist():
            self._plane.paste(colour, (x - half, y - half), stamp)
        if label:
            self._legend.append((shape, colour, label))

    def lines(
        self, starts: NDArray[np.floating], ends: NDArray[np.floating], colour: Colour, opacity: float = 1.0
    ) -> None:
        """Draw a line from each of (n, 2) or more columns of starts to its end."""
        for start, end in zip(self._pixels(starts).tolist(), self._pixels(ends).tolist(), strict=True):
            self._draw.line((*start, *end), fill=(*colour, round(255 * opacity)))

    def hatched(self, corners: NDArray[np.floating], side: float, colour: Colour, label: str) -> None:
        """Hatch the squares of a side whose south-western corners are (n, 2)."""
        fill = (*colour, 128)
        for x, y in self._pixels(corners).tolist():
            long = side / self._pixel
            for by in np.arange(0, 2 * long, _TICK).tolist():
                start, end = max(0.0, by - long), min(by, long)
                self._draw.line((x + start, y - by + start, x + end, y - by + end), fill=fill)
            self._draw.rectangle((x, y - long, x + long, y), outline=fill)
        if label:
            self._legend.append((SQUARE, colour, label))

    def text(self, place: tuple[float, float], text: str) -> None:
        """Write a few words beside a place."""
        ((x, y),) = self._pixels(np.array([place])).tolist()
        self._draw.text((x + 2, y - 2), text, BLACK, _font(_SMALL), anchor="ls")

    def save(self, path: Path, *, x: str, y: str, title: str = "") -> None:
        """Write the PNG, with the names of the axes."""
        width, height = self._size
        size = (_LEFT + width + _RIGHT, _TOP + height + _BOTTOM + _ROW * len(self._legend))
        whole = Image.new("RGB", size, WHITE)
        whole.paste(self._plane, (_LEFT, _TOP))
        draw = ImageDraw.Draw(whole)
        draw.rectangle((_LEFT - 1, _TOP - 1, _LEFT + width, _TOP + height), outline=BLACK)
        bottom, middle = _TOP + height, _LEFT + width / 2
        font, small = _font(_TEXT), _font(_SMALL)
        for value, at in _ticks(self._west, width, self._pixel):
            draw.line((_LEFT + at, bottom, _LEFT + at, bottom + _TICK), fill=BLACK)
            draw.text((_LEFT + at, bottom + _TICK + 2), value, BLACK, small, anchor="mt")
        for value, at in _ticks(self._north - height * self._pixel, height, self._pixel):
            draw.line((_LEFT - _TICK, bottom - at, _LEFT, bottom - at), fill=BLACK)
            draw.text((_LEFT - _TICK - 3, bottom - at), value, BLACK, small, anchor="rm")
        draw.text((middle, _TOP - 10), title, BLACK, font, anchor="ms")
        draw.text((middle, bottom + 42), x, BLACK, font, anchor="ms")
        whole.paste(_upright(y, font), (4, round(_TOP + height / 2 - font.getlength(y) / 2)))
        for row, (shape, colour, label) in enumerate(self._legend):
            at = bottom + _BOTTOM + _ROW * row + _ROW // 2
            stamp = _stamp(shape, 5, 1.0)
            whole.paste(colour, (_LEFT + 6 - stamp.width // 2, at - stamp.height // 2), stamp)
            draw.text((_LEFT + 18, at), label, BLACK, font, anchor="lm")
        whole.save(path, compress_level=4)

    def _pixels(self, places: NDArray[np.floating]) -> NDArray[np.float64]:
        """(n, 2) pixels of the plane, right and down."""
        xy = np.asarray(places, np.float64)[:, :2]
        return np.stack([xy[:, 0] - self._west, self._north - xy[:, 1]], axis=1) / self._pixel


def _ticks(start: float, pixels: int, pixel: float) -> list[tuple[str, float]]:
    """Round values along an axis of a start, each with its distance from the start in pixels."""
    least = 90 * pixel  # units between two ticks: room for a label
    power = 10.0 ** math.floor(math.log10(least))
    step = next(k * power for k in _STEPS if k * power >= least)
    digits = max(0, -math.floor(math.log10(step)))
    numbers = range(math.ceil(start / step), math.floor((start + pixels * pixel) / step) + 1)
    return [(f"{n * step:.{digits}f}", (n * step - start) / pixel) for n in numbers]


@lru_cache(16)
def _stamp(shape: str, radius: float, opacity: float) -> Image.Image:
    """A mark as a mask, smooth at its rim."""
    half = math.ceil(radius)
    at = (np.arange((2 * half + 1) * _FINER) + 0.5) / _FINER - half - 0.5
    x, y = np.abs(np.meshgrid(at, at))
    if shape == DISC:
        inside = x * x + y * y <= radius * radius
    elif shape == SQUARE:
        inside = np.maximum(x, y) <= radius
    else:
        inside = (np.abs(x - y) <= 1) & (np.maximum(x, y) <= radius)
    share = inside.reshape(2 * half + 1, _FINER, 2 * half + 1, _FINER).mean(axis=(1, 3))
    return Image.fromarray(np.rint(255 * opacity * share).astype(np.uint8))


@lru_cache(4)
def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


def _upright(text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont) -> Image.Image:
    """A line of text that reads upwards."""
    line = Image.new("RGB", (math.ceil(font.getlength(text)), _ROW), WHITE)
    ImageDraw.Draw(line).text((0, _ROW // 2), text, BLACK, font, anchor="lm")
    return line.transpose(Image.Transpose.ROTATE_90)
