"""Every instruction set's module, and none: the same bytes, and clear words where a module is missing."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import firstfix.native
from firstfix.native import choice
from tests.native import kernel_cases
from tests.native.recorder import kernels, recorded

REPO = Path(__file__).resolve().parents[2]
GOLDEN_VECTORS = """
import json
from clients.conformance.compare import difference
from clients.conformance.generate import FOLDER

vectors = json.loads((FOLDER / "index.json").read_text())["vectors"]
failed = [vector["name"] for vector in vectors if difference(FOLDER, vector)]
print(len(vectors), "vectors, failed:", failed)
"""
NAMED = "import firstfix.native as n; print(n.variant, n.source_digest)"
SOURCE_HASH = "from firstfix_builder.execution.source_hash import source_hash; print(source_hash())"


def with_variant(variant: str, *command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *command],
        cwd=REPO,
        env={**os.environ, "FIRSTFIX_NATIVE": variant},
        capture_output=True,
        text=True,
        check=False,
    )


def printed(variant: str, program: str) -> str:
    done = with_variant(variant, "-c", program)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture(scope="module")
def variants() -> list[str]:
    return choice.runnable()


def test_the_newest_that_runs_is_taken(variants: list[str]):
    assert variants[-1] == "baseline"
    assert printed("", NAMED) == printed("auto", NAMED) == printed(variants[0], NAMED)


def test_all_were_built_from_the_same_sources(variants: list[str]):
    said = {variant: printed(variant, NAMED).split() for variant in variants}
    assert {variant: name for variant, (name, _) in said.items()} == {v: v for v in variants}
    (digest,) = {digest for _, digest in said.values()}
    assert re.fullmatch(r"[0-9a-f]{64}", digest)


def test_builds_on_different_processors_share_their_stages(variants: list[str]):
    assert len({printed(variant, SOURCE_HASH) for variant in variants}) == 1


@pytest.mark.parametrize("number", range(len(choice.NEEDED_FLAGS) + 1))
def test_every_instruction_set_passes_the_golden_vectors(variants: list[str], number: int):
    names = ["off", *variants]
    if number >= len(names):
        pytest.skip(f"needs a newer processor: this processor runs {', '.join(variants)} alone")
    assert re.fullmatch(r"\d\d+ vectors, failed: \[\]", printed(names[number], GOLDEN_VECTORS))


@pytest.mark.parametrize("command", ["build", "serve"])
def test_a_command_without_the_core_says_what_is_missing(command: str, tmp_path: Path):
    (tmp_path / "map.ply").write_bytes(b"ply\n")
    arguments = {
        "build": ["build", str(tmp_path / "map.ply"), "--map-id", "a", "--sensor", "os1-64"],
        "serve": ["serve", "--port", "0"],
    }[command]
    done = with_variant("off", "-m", "firstfix_cli.main", *arguments, "--store", str(tmp_path / "store"))
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "firstfix: the compiled core is switched off (FIRSTFIX_NATIVE=off): "
        "the service and the builder need it"
    ]


def test_a_robot_needs_no_compiled_core():
    done = with_variant(
        "off", "-c", "import firstfix_client, firstfix; print(firstfix.Scan, firstfix.condense)"
    )
    assert done.returncode == 0, done.stderr


def test_a_missing_module_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(choice.VARIABLE, "auto")
    monkeypatch.setattr(choice, "EXTENSION_SUFFIXES", [".another-python.so"])
    with pytest.raises(ModuleNotFoundError, match=r"not built for this Python and processor .*make setup"):
        choice.load_kernels()


@pytest.mark.parametrize(("variant", "flags"), [("sse9", set()), ("avx512", {"avx2", "fma"})])
def test_a_module_that_the_processor_cannot_run_is_refused(variant: str, flags: set[str], monkeypatch):
    monkeypatch.setenv(choice.VARIABLE, variant)
    monkeypatch.setattr(choice, "_processor_flags", lambda: flags)
    with pytest.raises(ImportError, match=f"{variant}.*it can be auto, baseline or off"):
        choice.load_kernels()


def digests(variant: str) -> dict[str, str]:
    done = with_variant(variant, kernel_cases.__file__)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_every_kernel_has_a_case():
    wanted = kernels(firstfix.native)
    assert "within_range" in wanted
    assert {call.name for call in recorded(firstfix.native)} == wanted


def test_instruction_sets_agree_on_every_case():
    newest, *others = choice.runnable()
    wanted = digests(newest)
    for variant in others:
        found = digests(variant)
        assert [name for name in wanted if found[name] != wanted[name]] == [], variant


def test_a_case_gives_a_result_worth_comparing():
    for name, call in kernel_cases.CASES.items():
        parts = kernel_cases.parts_of(call(firstfix.native))
        assert parts, name
        assert all(np.size(part) > 0 for part in parts), name
