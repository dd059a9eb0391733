"""Findings that the self-test of a version shows."""

import pytest

from firstfix.catalog.manifest import Manifest
from firstfix.catalog.version_findings import findings_of


@pytest.mark.parametrize(("in_part", "is_found"), [(0, False), (10, False), (11, True), (100, True)])
def test_many_places_mapped_in_part_are_a_finding(in_part, is_found):
    tested = {"mapped": {"places": 100, "in_part": in_part}}
    found = findings_of(Manifest({}, self_test=tested))
    assert [one.code for one in found] == (["map_in_part"] if is_found else [])
    if is_found:
        assert f"Of 100 places, {in_part} were mapped in part" in found[0].text


def test_versions_that_do_not_know_it_have_no_such_finding():
    for tested in ({}, {"mapped": None}, {"mapped": {"places": 0, "in_part": 0}}):
        assert findings_of(Manifest({}, self_test=tested)) == []
