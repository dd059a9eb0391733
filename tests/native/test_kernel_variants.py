"""Every kernel gives the same bytes in the module of each instruction set."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

import firstfix.native
from firstfix.native import choice
from tests.native import kernel_cases
from tests.native.recorder import kernels, recorded


def digests(variant: str) -> dict[str, str]:
    done = subprocess.run(
        [sys.executable, Path(kernel_cases.__file__)],
        env={**os.environ, choice.VARIABLE: variant},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, str] = json.loads(done.stdout)
    return found


def test_every_kernel_has_a_case():
    wanted = kernels(firstfix.native)
    assert "within_range" in wanted
    assert {call.name for call in recorded(firstfix.native)} == wanted


def test_the_instruction_sets_agree():
    newest, *others = choice.runnable()
    wanted = digests(newest)
    for variant in others:
        found = digests(variant)
        assert [name for name in wanted if found[name] != wanted[name]] == [], variant


def test_a_case_gives_a_result_worth_comparing():
    for name, call in kernel_cases.CASES.items():
        result = call(firstfix.native)
        parts = result if isinstance(result, tuple) else (result,)
        assert all(np.size(part) > 0 and part is not None for part in parts), name
