"""Versions given by their first characters."""

from __future__ import annotations

import pytest

from firstfix.catalog.version_prefix import full_version
from firstfix.errors import InvalidOption, NotFound

VERSIONS = ["0123456789" + "a" * 54, "01234567ff" + "a" * 54, "ff" * 32]


def test_the_version_that_begins_so():
    assert full_version("0123456789", VERSIONS) == VERSIONS[0]
    assert full_version("FFFF", VERSIONS) == VERSIONS[2]
    assert full_version(VERSIONS[1], VERSIONS) == VERSIONS[1]


def test_a_whole_version_is_not_looked_up():
    assert full_version("ab" * 32, VERSIONS) == "ab" * 32


@pytest.mark.parametrize(
    ("given", "error", "says"),
    [
        ("012", InvalidOption, "4 or more of its first characters"),
        ("01234567", InvalidOption, "2 versions begin with 01234567, such as 0123456789"),
        ("aaaaaaaa", NotFound, "no version begins with aaaaaaaa"),
        ("0123456g", InvalidOption, "not a map version"),
        ("a" * 65, InvalidOption, "not a map version"),
        ("", InvalidOption, "not a map version"),
    ],
)
def test_none_several_or_no_version_at_all(given: str, error: type[Exception], says: str):
    with pytest.raises(error, match=says):
        full_version(given, VERSIONS)
