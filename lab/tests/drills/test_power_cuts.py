"""The power is cut at random moments, a few times: ``firstfix-lab power_cuts`` does it 50 times."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix_lab.drills.power_cuts import is_another, power_cuts
from tests.disk_image import why_no_images


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_power_cuts_take_nothing_that_was_acknowledged(tmp_path: Path):
    if why := why_no_images():
        pytest.skip(why)
    figures = power_cuts(tmp_path, cuts=2, seed=3)
    assert sum(figures["cuts"].values()) == 2
    assert figures["builds_acknowledged"] > 0
    for name in ("lost", "torn", "broken", "not_serving", "not_succeeded"):
        assert not figures[name], name
    assert figures["file_system_is_whole"]


def test_a_version_that_a_build_activates_between_two_looks_is_not_taken_for_hidden():
    active = iter(["old", "new", "new", "new"])
    assert not is_another(lambda: next(active), lambda: "new")
    assert is_another(lambda: "new", lambda: "old")
    assert is_another(lambda: None, lambda: "old")
