"""A program that calls every kernel with arguments that nobody should pass.

A kernel may refuse them (TypeError, ValueError, an error of firstfix) or give a result. It prints each
kernel's name before it is called: the last one is where a crash is.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import firstfix.native
from firstfix.errors import FirstfixError
from tests.native.recorder import Call, recorded

PAIRS = 40  # of wrong arguments at a time, for each call
NUMBERS = (0, 1, -1, 2, 255, 2**31 - 1, 2**31, 2**63, -(2**63), 10**30)
REALS = (0.0, -0.0, -1.0, 1e-320, 1e-30, 1e300, -1e300, np.nan, np.inf, -np.inf)
ANYTHING: tuple[Any, ...] = (None, "text", b"bytes", [], {}, object(), 1j, True, [[1.0], [2.0]])


def wrong(value: Any) -> Iterator[Any]:
    """Values in the place of one that a kernel accepts."""
    if isinstance(value, np.ndarray):
        yield from wrong_types(value)
        yield from wrong_shapes(value)
        yield from wrong_content(value)
    else:
        yield np.asarray(0.5)
    if isinstance(value, (bool, int, float)):
        yield from (NUMBERS if isinstance(value, int) else REALS)
    yield from ANYTHING


def wrong_types(array: NDArray[Any]) -> Iterator[Any]:
    for dtype in ("f8", "f4", "f2", ">f4", "i8", "u4", "i1", "?", "c8", "O", "U8", "M8[s]"):
        with np.errstate(all="ignore"):
            yield array.astype(dtype)
    unaligned = np.zeros(array.nbytes + 1, np.uint8)[1:].view(array.dtype).reshape(array.shape)
    unaligned[...] = array
    yield unaligned
    yield array.tolist()


def wrong_shapes(array: NDArray[Any]) -> Iterator[Any]:
    yield from (
        array[:0],
        array[:1],
        array[:-1],
        array[::2],
        array[::-1],
        array[None],
        array.ravel(),
        array.T,
    )
    yield from (array[..., :0], array[..., :-1], array[..., ::-1], np.asfortranarray(array))
    yield np.concatenate([array, array])
    yield np.zeros((), array.dtype)
    yield np.zeros((0,) * array.ndim, array.dtype)
    yield np.broadcast_to(array[:1], array.shape)
    yield np.lib.stride_tricks.as_strided(array, array.shape, (0,) * array.ndim)


def wrong_content(array: NDArray[Any]) -> Iterator[Any]:
    if array.dtype == np.bool_:
        yield np.full(array.shape, 2, np.uint8).view(np.bool_)
        return
    if array.dtype.kind == "f":
        values = [np.nan, np.inf, -np.inf, 3e38, -3e38, 1e-45, 0, -1, 2**31]
    else:
        values = [np.iinfo(array.dtype).min, np.iinfo(array.dtype).max, 0, 1]
    for value in values:
        yield np.full_like(array, value)
        some = array.copy()
        some.flat[:: max(1, some.size // 7)] = value
        yield some


def tried(call: Call, arguments: tuple[Any, ...]) -> bool:
    """Returns whether the kernel gave a result."""
    try:
        with np.errstate(all="ignore"):
            call.function(*arguments)
    except (TypeError, ValueError, FirstfixError):
        return False
    return True


def main() -> None:
    rng = random.Random(1)
    refused = given = 0
    for call in recorded(firstfix.native):
        print(call.name, flush=True)
        # A method's object stays as it is; a constructor's and a function's arguments are all tried.
        changed = [list(wrong(value)) for value in call.arguments]
        attempts = [
            (*call.arguments[:place], value, *call.arguments[place + 1 :])
            for place, values in enumerate(changed)
            for value in values
        ]
        for _ in range(PAIRS if len(changed) > 1 else 0):
            both = list(call.arguments)
            for place in rng.sample(range(len(changed)), 2):
                both[place] = rng.choice(changed[place])
            attempts.append(tuple(both))
        attempts += [call.arguments[:-1], (*call.arguments, 1)]
        for arguments in attempts:
            if tried(call, arguments):
                given += 1
            else:
                refused += 1
        assert tried(call, call.arguments), f"{call.name} no longer accepts what it accepted"
    print(f"{refused} refused, {given} gave a result")


if __name__ == "__main__":
    main()
