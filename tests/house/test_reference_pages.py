"""The reference pages name every setting, metric and public name, and none that do not exist."""

import re
from pathlib import Path
from types import ModuleType

import pytest
from fastapi.testclient import TestClient

import firstfix
import firstfix_client
from firstfix.catalog.manifest import FORMAT
from firstfix_service.app import create_app
from firstfix_service.settings import Settings

DOCS = Path(__file__).resolve().parents[2] / "docs"
REFERENCE = DOCS / "reference"


def rows(page: str) -> dict[str, list[str]]:
    """The rows of a page's tables: first column's code -> the other columns."""
    cells = [
        [cell.strip() for cell in line.strip("|").split(" | ")]
        for line in re.findall(r"^\| `.*$", (REFERENCE / page).read_text(), re.M)
    ]
    assert len(cells) == len({first for first, *_ in cells}), "one row for each"
    return {first.strip("`"): rest for first, *rest in cells}


def test_every_setting_is_documented_with_its_default():
    documented = rows("settings.md")
    assert set(documented) == {f"FIRSTFIX_{name.upper()}" for name in Settings.model_fields}
    for name, field in Settings.model_fields.items():
        fixed = name != "workers" and isinstance(field.default, int | float | str)  # workers: as many as CPUs
        if fixed and not isinstance(field.default, bool):
            assert documented[f"FIRSTFIX_{name.upper()}"][0] == f"`{field.default}`"


def test_every_metric_is_documented(tmp_path: Path):
    settings = Settings(store=str(tmp_path / "store"), work_dir=tmp_path / "work", run_builds=False)
    with TestClient(create_app(settings)) as client:
        shown = client.get("/metrics").text
    names = set(re.findall(r"^# TYPE (firstfix_\w+) ", shown, re.M))
    assert set(rows("metrics.md")) == {name for name in names if not name.endswith("_created")}


@pytest.mark.parametrize(("name", "package"), [("python-api", firstfix_client), ("core-api", firstfix)])
def test_every_public_name_is_documented(name: str, package: ModuleType):
    page = (REFERENCE / f"{name}.md").read_text()
    documented = re.findall(rf"^::: {package.__name__}\.(\w+)$", page, re.M)
    assert sorted(documented) == sorted(set(package.__all__) - {"__version__"})


def test_the_format_of_versions_is_the_documented_one():
    page = (DOCS / "how-to" / "operate.md").read_text()
    assert f"This release makes and reads format **{FORMAT}**" in page
