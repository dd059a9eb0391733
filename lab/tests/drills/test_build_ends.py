"""Ends of builds, some of them: ``firstfix-lab ends`` has them all."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from firstfix_lab.drills.ends import ends

pytestmark = pytest.mark.slow


def test_the_store_holds_what_the_answers_said(tmp_path: Path):
    tried: list[str] = []
    names = ["cancel in the queue", "cancel a deaf stage", "cancel and kill the service"]
    figures = ends(tmp_path, names, say=tried.append)
    assert len(tried) == figures["tried"] == 8
    assert not figures["wrong"]


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, who mounts a small disk: sudo make test")
def test_a_full_store_is_waited_for(tmp_path: Path):
    figures = ends(tmp_path, ["store full for a while"], say=print)
    assert figures["tried"] == 1
    assert not figures["wrong"]
