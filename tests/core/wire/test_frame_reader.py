"""Frames of a body: each thread keeps what decompresses them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import zstandard

from firstfix.errors import MalformedData
from firstfix.wire.frame_reader import FrameReader

CONTENTS = [
    np.random.default_rng(seed).integers(0, 40, 3000 + seed, np.uint8).tobytes() for seed in range(40)
]
FRAMES = [zstandard.ZstdCompressor().compress(content) for content in CONTENTS]


def content_of(frame: bytes) -> bytes:
    return FrameReader(frame, "body").frame(len(frame), 1, 10_000)


@pytest.mark.parametrize("damage", ["cut", "flipped", "longer"])
def test_a_damaged_frame_leaves_the_next_one_readable(damage: str):
    frame = bytearray(FRAMES[0])
    if damage == "cut":
        del frame[-20:]
    elif damage == "flipped":
        frame[6:] = bytes(byte ^ 0xFF for byte in frame[6:])
    else:
        frame += FRAMES[1]
    for _ in range(3):
        with pytest.raises(MalformedData):
            content_of(bytes(frame))
        assert content_of(FRAMES[0]) == CONTENTS[0]


def test_threads_read_frames_at_once():
    with ThreadPoolExecutor(4) as threads:
        assert list(threads.map(content_of, FRAMES * 20)) == CONTENTS * 20
