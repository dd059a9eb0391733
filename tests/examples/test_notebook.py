"""The notebook runs from its first cell to its last, and its outputs are stored."""

import importlib.util
import json
from pathlib import Path
from types import ModuleType

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # the notebook builds a map

REPO = Path(__file__).resolve().parents[2]
NOTEBOOK = REPO / "docs" / "notebooks" / "first_fix.ipynb"
MAX_BYTES = 300_000


def runner() -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        "run_notebook", REPO / "scripts" / "site" / "run_notebook.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def code_cells() -> list[dict]:
    return [cell for cell in json.loads(NOTEBOOK.read_text())["cells"] if cell["cell_type"] == "code"]


def kinds(outputs: list[dict]) -> list[str]:
    return [kind for output in outputs for kind in output.get("data", {"text": None})]


def test_every_cell_runs_and_gives_what_is_stored():
    run = runner().run_cells(json.loads(NOTEBOOK.read_text()))
    stored = [cell["outputs"] for cell in code_cells()]
    assert [kinds(outputs) for outputs in run] == [kinds(outputs) for outputs in stored]
    assert any("image/png" in kinds(outputs) for outputs in run)
    said = "".join(line for outputs in run for output in outputs for line in output.get("text", ()))
    assert "in the map:  localized" in said
    assert "elsewhere:   rejected" in said


def test_the_notebook_is_small_and_executed_in_order():
    assert NOTEBOOK.stat().st_size < MAX_BYTES
    assert [cell["execution_count"] for cell in code_cells()] == list(range(1, len(code_cells()) + 1))
