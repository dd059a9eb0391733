"""Random wounds of bytes: what disks, networks and malice do to files and bodies."""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np

_NUMBERS = [
    b"-1",
    b"0",
    b"99999999999999999999",
    b"1e308",
    b"-1e-400",
    b"nan",
    b"inf",
    b"0x10",
    b"\x00",
    b"\xff",
]
_WORDS = [b"list", b"double", b"DATA", b"end_header", b"\n", b"\r\n", b" ", b"binary_compressed", b"ascii"]
_EXTREMES = [0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 2**63, 2**64 - 1]
FLOATS = [np.nan, np.inf, -np.inf, 1e30, -1e30, 1e-45, 3.4e38, 0.0]
_HEAD_BYTES = 400  # where formats declare their counts


def wounded(data: bytes, rng: np.random.Generator, *, in_place: bool = False) -> bytes:
    """The bytes with one to six random wounds.

    Args:
        in_place: one or two, that leave all other bytes where they are: a reader gets further.
    """
    wounds = bytearray(data)
    kinds = _IN_PLACE if in_place else _WOUNDS
    for _ in range(rng.integers(1, 3 if in_place else 7)):
        wound = kinds[rng.integers(len(kinds))]
        wounds = wound(wounds, rng) or bytearray(b"x")
    return bytes(wounds)


def _flip(data: bytearray, rng: np.random.Generator) -> bytearray:
    data[rng.integers(len(data))] ^= int(rng.integers(1, 256))
    return data


def _flip_early(data: bytearray, rng: np.random.Generator) -> bytearray:
    data[rng.integers(min(len(data), 80))] ^= int(rng.integers(1, 256))
    return data


def _insert(data: bytearray, rng: np.random.Generator) -> bytearray:
    place = int(rng.integers(len(data) + 1))
    data[place:place] = rng.bytes(int(rng.integers(1, 40)))
    return data


def _remove(data: bytearray, rng: np.random.Generator) -> bytearray:
    place = int(rng.integers(len(data)))
    del data[place : place + int(rng.integers(1, 40))]
    return data


def _cut(data: bytearray, rng: np.random.Generator) -> bytearray:
    return data[: int(rng.integers(len(data) + 1))]


def _repeat(data: bytearray, rng: np.random.Generator) -> bytearray:
    start, end = sorted(int(place) for place in rng.integers(len(data) + 1, size=2))
    return data[:end] + data[start:end] * int(rng.integers(1, 20)) + data[end:]


def _word(data: bytearray, rng: np.random.Generator) -> bytearray:
    words = _NUMBERS + _WORDS
    place = int(rng.integers(len(data)))
    data[place : place + int(rng.integers(0, 4))] = words[rng.integers(len(words))]
    return data


def _number(data: bytearray, rng: np.random.Generator) -> bytearray:
    """One of the numbers of a text, replaced."""
    digits = [place for place, byte in enumerate(data) if 48 <= byte <= 57]
    if not digits:
        return data
    start = digits[rng.integers(len(digits))]
    end = start
    while end < len(data) and 48 <= data[end] <= 57:
        end += 1
    return data[:start] + _NUMBERS[rng.integers(len(_NUMBERS))] + data[end:]


def _extreme(data: bytearray, rng: np.random.Generator, within: int | None = None) -> bytearray:
    """A binary number of 1, 2, 4 or 8 bytes, replaced by one at the end of a range."""
    size = int(2 ** rng.integers(0, 4))
    place = int(rng.integers(min(len(data), within or len(data))))
    value = _EXTREMES[rng.integers(len(_EXTREMES))] % 2 ** (8 * size)
    size = min(size, len(data) - place)
    data[place : place + size] = value.to_bytes(8, "little")[:size]
    return data


def _extreme_early(data: bytearray, rng: np.random.Generator) -> bytearray:
    return _extreme(data, rng, _HEAD_BYTES)


def _float(data: bytearray, rng: np.random.Generator) -> bytearray:
    place = int(rng.integers(len(data))) // 4 * 4
    value = struct.pack("<f", FLOATS[rng.integers(len(FLOATS))])
    data[place : place + 4] = value[: len(data) - place]
    return data


_Wound = Callable[[bytearray, np.random.Generator], bytearray]
_IN_PLACE: list[_Wound] = [_flip, _flip_early, _extreme, _extreme_early, _float]
_WOUNDS: list[_Wound] = [*_IN_PLACE, _insert, _remove, _cut, _repeat, _word, _number]
