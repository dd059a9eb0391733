from __future__ import annotations

import gzip

import numpy as np
import pytest
import zstandard

from firstfix.errors import MalformedData, TooLarge, UnsupportedFormat
from firstfix.wire.content_encoding import undo_content_encoding
from tests.core.fixtures import in_memory_of
from tests.core.test_damaged_bodies import zstd_without_size
from tests.every_case import every_case

PLAIN = np.random.default_rng(5).integers(0, 20, 300_000, np.uint8).tobytes()


PACKED = {
    "gzip": gzip.compress(PLAIN),
    "x-gzip": gzip.compress(PLAIN),
    " GZIP ": gzip.compress(PLAIN),
    "zstd": zstandard.compress(PLAIN),
    "Zstd": zstd_without_size(PLAIN),
    "identity": PLAIN,
    "": PLAIN,
}


@every_case(
    ("encoding", "pack"), [("gzip", gzip.compress), ("zstd", zstandard.compress), ("zstd", zstd_without_size)]
)
def test_an_empty_body_comes_back_and_noise_is_malformed(encoding, pack):
    assert undo_content_encoding(pack(b""), encoding, 10) == b""
    with pytest.raises(MalformedData):
        undo_content_encoding(b"no such thing", encoding, 10**6)


@every_case("encoding", PACKED)
def test_the_body_comes_back_up_to_the_limit(encoding):
    assert undo_content_encoding(PACKED[encoding], encoding, len(PLAIN)) == PLAIN
    with pytest.raises(TooLarge):
        undo_content_encoding(PACKED[encoding], encoding, len(PLAIN) - 1)


@every_case("encoding", ["br", "gzip, zstd", "deflate"])
def test_other_encodings_are_unsupported(encoding):
    with pytest.raises(UnsupportedFormat, match="gzip, zstd"):
        undo_content_encoding(b"x", encoding, 10)


@every_case("pack", [gzip.compress, zstandard.compress, zstd_without_size])
def test_a_bomb_is_refused_in_little_memory(pack):
    bomb = pack(bytes(200_000_000))
    encoding = "gzip" if pack is gzip.compress else "zstd"
    with in_memory_of(50_000_000), pytest.raises(TooLarge):
        undo_content_encoding(bomb, encoding, 1_000_000)
