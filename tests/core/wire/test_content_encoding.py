from __future__ import annotations

import gzip
import tracemalloc

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from firstfix.errors import InputError, MalformedData, TooLarge, UnsupportedFormat
from firstfix.wire.content_encoding import undo_content_encoding
from tests.every_case import every_case

PLAIN = np.random.default_rng(5).integers(0, 20, 300_000, np.uint8).tobytes()


def zstd_without_size(data: bytes) -> bytes:
    stream = zstandard.ZstdCompressor().compressobj()
    return stream.compress(data) + stream.flush()


PACKED = {
    "gzip": gzip.compress(PLAIN),
    "x-gzip": gzip.compress(PLAIN),
    " GZIP ": gzip.compress(PLAIN),
    "zstd": zstandard.compress(PLAIN),
    "Zstd": zstd_without_size(PLAIN),
    "identity": PLAIN,
    "": PLAIN,
}


@every_case("encoding", PACKED)
def test_the_body_comes_back_up_to_the_limit(encoding):
    assert undo_content_encoding(PACKED[encoding], encoding, len(PLAIN)) == PLAIN
    with pytest.raises(TooLarge):
        undo_content_encoding(PACKED[encoding], encoding, len(PLAIN) - 1)


@every_case("encoding", ["gzip", "zstd", "Zstd"])
def test_an_empty_body_that_was_packed_is_empty(encoding):
    packed = {"gzip": gzip.compress(b""), "zstd": zstandard.compress(b""), "Zstd": zstd_without_size(b"")}
    assert undo_content_encoding(packed[encoding], encoding, 10) == b""


@every_case("encoding", ["gzip", "zstd", "Zstd"])
def test_cut_off_and_trailing_bytes_are_malformed(encoding):
    packed = PACKED[encoding]
    for damaged in (
        packed[:-1],
        packed[: len(packed) // 2],
        packed[:3],
        b"",
        packed + b"x",
        b"no such thing",
    ):
        with pytest.raises(MalformedData):
            undo_content_encoding(damaged, encoding, 10**6)


@every_case("encoding", ["br", "gzip, zstd", "deflate"])
def test_other_encodings_are_unsupported(encoding):
    with pytest.raises(UnsupportedFormat, match="gzip, zstd"):
        undo_content_encoding(b"x", encoding, 10)


@every_case("pack", [gzip.compress, zstandard.compress, zstd_without_size])
def test_a_bomb_is_refused_in_little_memory(pack):
    bomb = pack(bytes(200_000_000))
    encoding = "gzip" if pack is gzip.compress else "zstd"
    tracemalloc.start()
    with pytest.raises(TooLarge):
        undo_content_encoding(bomb, encoding, 1_000_000)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50_000_000


@pytest.mark.parametrize("encoding", ["gzip", "zstd", "Zstd"])
@given(place=st.integers(0, 400), flip=st.integers(1, 255))
@settings(max_examples=200, deadline=None, derandomize=True)
def test_damage_gives_only_input_errors(encoding, place, flip):
    packed = {"gzip": gzip.compress, "zstd": zstandard.compress, "Zstd": zstd_without_size}[encoding](
        PLAIN[:500]
    )
    damaged = bytearray(packed)
    damaged[place % len(damaged)] ^= flip
    try:
        undo_content_encoding(bytes(damaged), encoding, 1000)
    except InputError:
        return
