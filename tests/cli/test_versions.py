"""Version prefixes must be long enough and match one version."""

from __future__ import annotations

import pytest

from firstfix.errors import InvalidOption, NotFound
from firstfix_cli.versions import full_version

VERSIONS = ["0123456789" + "a" * 54, "01234567ff" + "a" * 54, "ff" * 32]


def test_the_version_that_begins_so():
    assert full_version("0123456789", VERSIONS) == VERSIONS[0]
    assert full_version("FFFFFFFF", VERSIONS) == VERSIONS[2]
    assert full_version(VERSIONS[1], VERSIONS) == VERSIONS[1]


@pytest.mark.parametrize(
    ("prefix", "error"), [("0123456", InvalidOption), ("01234567", InvalidOption), ("aaaaaaaa", NotFound)]
)
def test_none_several_or_too_short(prefix, error):
    with pytest.raises(error):
        full_version(prefix, VERSIONS)
