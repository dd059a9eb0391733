from __future__ import annotations

import posixpath
import re
import unicodedata
from urllib.parse import quote, unquote

import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firstfix.builds.source_policy import check_source_url
from firstfix.errors import InvalidOption
from firstfix.store.url import StoreUrl

ALLOWED = ("s3://bucket/maps/", "https://files.example.org", "https://other.example.org/a")


BELOW = """
    s3://bucket/maps/hall.laz https://files.example.org/x.laz?X-Signature=1 https://FILES.example.org/x.laz
    https://other.example.org/a/b.ply https://other.example.org/a https://files.example.org/über..laz
    https://files.example.org/hall%20of%20fame/a+b@1,(2).laz s3://bucket/maps/50%23.laz
    https://files.example.org/%C3%BCber.laz?path=../x https://files.example.org/a...b/.hidden/...
"""


@pytest.mark.parametrize("url", BELOW.split())
def test_a_url_below_an_allowed_prefix_is_taken(url: str):
    assert check_source_url(url, ALLOWED) == url


REFUSED = """
    s3://bucket/other/hall.laz s3://bucket/maps/../other/hall.laz s3://bucket/maps/%2e%2e/other/hall.laz
    s3://bucket/maps/..%2fother s3://bucket/maps/x?endpoint=http://10.0.0.1 s3://user:secret@bucket/maps/x
    s3://bucket2/maps/x http://files.example.org/x.laz https://files.example.org.evil.net/x
    https://files.example.org@evil.net/x https://files.example.org:8443/x https://other.example.org/ab
    file:///etc/passwd /etc/passwd https://[files/x https://files.example.org/x#y
    https://other.example.org/a/%252e%252e/b https://other.example.org/a/%25252e%25252e/b
    https://other.example.org/a/.%2e/b https://other.example.org/a/x%2f..%2f..%2fb
    https://other.example.org/a/..;/b https://other.example.org/a/..;x=1/b
    https://other.example.org/a/..%3b/b https://other.example.org/a/x;v=1/b
    https://other.example.org/a/..%5cb https://other.example.org/a/%c0%ae%c0%ae/b
    https://other.example.org/a/%e0%80%af../b https://other.example.org/a/%ef%bc%8e%ef%bc%8e/b
    https://other.example.org/a/x%00.laz https://other.example.org/a/x%0d%0aHost:%20evil
    https://other.example.org/a/%7Fx https://other.example.org/a/100% https://other.example.org/a/%zz
    https://other.example.org/%61/b https://other.example.org/a//b https://other.example.org//a/b
    https://other.example.org/a/./b https://other.example.org/a/. https://other.example.org%2fa/b
    https://other.example.org%00/a/b https://@other.example.org/a/b https://other.example.org:/a/b
    https:other.example.org/a/b https:///other.example.org/a/b //other.example.org/a/b
"""
ODD = [
    "https://files.example.org/a b",
    "https://files.example.org/\n",
    "https://other.example.org/a\\..\\b",
    "https://other.example.org/a/\uff0e\uff0e/b",
    "https://other.example.org/a/\u2025/b",
    "https://oth\u0435r.example.org/a/b",
    "https://other.example.org\\@evil.net/a/b",
    "",
    "https://files.example.org/" + "x" * 3000,
]


@pytest.mark.parametrize("url", [*REFUSED.split(), *ODD])
def test_any_other_url_is_refused(url: str):
    with pytest.raises(InvalidOption):
        check_source_url(url, ALLOWED)


def test_nothing_is_allowed_by_default():
    with pytest.raises(InvalidOption, match="not allowed"):
        check_source_url("https://files.example.org/x", ())


WORDS = "// .. %2e %2E %2f %5c %25 %252e %3b %00 %c0%ae %20 %C3%BC evil.net other"
PIECES = st.sampled_from([*WORDS.split(), *"ab./\\;%?#@:\uff0e\uff0f\u2025\u00fc\t"])


def decodings(path: str) -> set[str]:
    """Paths that different servers may read from a URL."""
    found = {path}
    for _ in range(4):
        found |= {unquote(one) for one in found}
        found |= {one.replace("\\", "/") for one in found}
        found |= {"/".join(part.split(";")[0] for part in one.split("/")) for one in found}
        found |= {one.replace("\uff0e", ".").replace("\uff0f", "/").replace("\u2025", "..") for one in found}
    return found


@given(st.lists(PIECES, max_size=9).map("".join))
def test_a_sent_path_is_below_the_prefix_however_it_is_read(rest: str):
    url = f"https://other.example.org/a/{rest}"
    try:
        check_source_url(url, ALLOWED)
    except InvalidOption:
        return
    sent = httpx.URL(url)
    assert (sent.scheme, sent.host, sent.port, sent.userinfo) == ("https", "other.example.org", None, b"")
    for path in decodings(sent.raw_path.decode("ascii").split("?")[0]):
        assert posixpath.normpath(path) == path.rstrip("/")
        assert f"{path}/".startswith("/a/")


@given(st.lists(PIECES, max_size=9).map("".join))
def test_a_key_in_a_bucket_is_below_the_prefix(rest: str):
    try:
        url = check_source_url(f"s3://bucket/maps/{rest}", ALLOWED)
    except InvalidOption:
        return
    where = StoreUrl.parse(url)
    assert where.bucket == "bucket"
    for path in decodings(where.prefix):
        assert f"{posixpath.normpath(path)}/".startswith("maps/")


@given(
    st.text(
        st.characters(codec="utf-8", exclude_categories=["C", "Z"], exclude_characters="/\\;%"), min_size=1
    )
)
def test_a_name_in_any_language_is_taken_when_it_is_encoded(name: str):
    url = f"https://files.example.org/maps/{quote(name, safe='')}-1"
    if re.search(r"[./\\;%]", unicodedata.normalize("NFKC", name.replace(".", ""))):
        with pytest.raises(InvalidOption, match="read as another"):
            check_source_url(url, ALLOWED)
    else:
        assert check_source_url(url, ALLOWED) == url
