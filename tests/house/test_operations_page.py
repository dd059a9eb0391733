"""docs/operations.md names every setting and every metric that there is, and none that there is not."""

import re
from pathlib import Path

from fastapi.testclient import TestClient

from firstfix_service.app import create_app
from firstfix_service.settings import Settings

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "operations.md").read_text()


def rows(heading: str) -> dict[str, list[str]]:
    """The first table below a heading: first column's code -> the other columns."""
    section = PAGE.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    cells = [
        [cell.strip() for cell in line.strip("|").split(" | ")]
        for line in re.findall(r"^\| `.*$", section, re.M)
    ]
    return {first.strip("`"): rest for first, *rest in cells}


def test_every_setting_is_documented_with_its_default():
    documented = rows("Settings")
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
    assert set(rows("Metrics")) == {name for name in names if not name.endswith("_created")}
