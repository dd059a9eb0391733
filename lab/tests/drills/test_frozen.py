"""Each part of a deployment frozen for a moment: ``firstfix-lab frozen`` does it for longer."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix_lab.checkout import ROOT
from firstfix_lab.drills.freezing.case import Case
from firstfix_lab.drills.freezing.part import Part
from firstfix_lab.drills.frozen import PARTS, frozen
from tests.nats_server import NEEDS_NATS, nats_server_program
from tests.servers import program
from tests.waiting import LIMIT_S

pytestmark = pytest.mark.slow

MOMENT_S = 1.5
READERS = 20
PAIR = ("object store", "NATS")


def cases(parts: dict[str, Part]) -> list[Case]:
    alone = [Case((parts[name],), "kill" if name in PAIR else "thaw", MOMENT_S, LIMIT_S) for name in PARTS]
    return [*alone, Case(tuple(parts[name] for name in PAIR), "thaw", MOMENT_S, LIMIT_S)]


def test_all_others_are_answered_and_everything_comes_back(tmp_path: Path):
    program("versitygw", "make test-servers")
    if nats_server_program() is None:
        pytest.skip(NEEDS_NATS)
    found, left = frozen(tmp_path, ROOT, cases, lambda figures: None, READERS)
    assert len(found) == len(PARTS) + 1
    assert {one.name: one.missed for one in found if one.missed} == {}, "what was missed in time is not here"
    assert not left
