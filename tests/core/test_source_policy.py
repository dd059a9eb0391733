from __future__ import annotations

import pytest

from firstfix.errors import InvalidOption
from firstfix.source_policy import check_source_url

ALLOWED = ("s3://bucket/maps/", "https://files.example.org", "https://other.example.org/a")


@pytest.mark.parametrize(
    "url",
    [
        "s3://bucket/maps/hall.laz",
        "https://files.example.org/x.laz?X-Signature=1",
        "https://FILES.example.org/x.laz",
        "https://other.example.org/a/b.ply",
        "https://other.example.org/a",
    ],
)
def test_below_an_allowed_prefix(url: str):
    assert check_source_url(url, ALLOWED) == url


@pytest.mark.parametrize(
    "url",
    [
        "s3://bucket/other/hall.laz",
        "s3://bucket/maps/../other/hall.laz",
        "s3://bucket/maps/%2e%2e/other/hall.laz",
        "s3://bucket/maps/..%2fother",
        "s3://bucket/maps/x?endpoint=http://10.0.0.1",
        "s3://user:secret@bucket/maps/x",
        "s3://bucket2/maps/x",
        "http://files.example.org/x.laz",
        "https://files.example.org.evil.net/x",
        "https://files.example.org@evil.net/x",
        "https://files.example.org:8443/x",
        "https://other.example.org/ab",
        "file:///etc/passwd",
        "/etc/passwd",
        "https://files.example.org/a b",
        "https://files.example.org/\n",
        "https://[files/x",
        "https://files.example.org/x#y",
        "https://files.example.org/" + "x" * 3000,
        "",
    ],
)
def test_anything_else_is_refused(url: str):
    with pytest.raises(InvalidOption):
        check_source_url(url, ALLOWED)


def test_nothing_is_allowed_by_default():
    with pytest.raises(InvalidOption, match="not allowed"):
        check_source_url("https://files.example.org/x", ())
