"""The packages are rooms: few at the top, none crowded, no file so long that it holds two concepts."""

from __future__ import annotations

from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parents[2]
MOST_FILES, MOST_LINES = 15, 400
ROOMS_AT_THE_TOP = {
    "core/firstfix": 20,
    "service/firstfix_service": 18,
    "builder/firstfix_builder": 15,
    "clients/python/firstfix_client": 15,
}
PACKAGES = [*ROOMS_AT_THE_TOP, "cli/firstfix_cli", "worlds/firstfix_worlds"]
TESTS = {
    "core/firstfix": "core",
    "service/firstfix_service": "service",
    "builder/firstfix_builder": "builder",
    "clients/python/firstfix_client": "client",
}


def entries(folder: Path) -> list[Path]:
    """Modules and packages in a folder, but its own ``__init__``."""
    modules = [path for path in folder.glob("*.py") if path.name != "__init__.py"]
    return modules + [path for path in folder.iterdir() if (path / "__init__.py").is_file()]


@pytest.mark.parametrize("package", ROOMS_AT_THE_TOP)
def test_the_top_of_a_package_is_a_short_list(package: str):
    found = sorted(path.name for path in entries(REPO / package))
    assert len(found) <= ROOMS_AT_THE_TOP[package], found


@pytest.mark.parametrize("package", PACKAGES)
def test_no_room_is_crowded_and_no_file_is_long(package: str):
    for folder in {path.parent for path in (REPO / package).rglob("*.py")}:
        if folder != REPO / package:
            files = [path for path in folder.glob("*.py") if path.name != "__init__.py"]
            assert len(files) <= MOST_FILES, f"{folder.relative_to(REPO)} has {len(files)} files"
    for path in (REPO / package).rglob("*.py"):
        lines = len(path.read_text().splitlines())
        assert lines <= MOST_LINES, f"{path.relative_to(REPO)} has {lines} lines"


@pytest.mark.parametrize("package", TESTS)
def test_tests_mirror_the_rooms(package: str):
    own = REPO / "tests" / TESTS[package]
    folders = {path.parent.relative_to(own) for path in own.rglob("test_*.py")}
    assert folders > {Path()}
    strange = [folder.as_posix() for folder in folders if not (REPO / package / folder).is_dir()]
    assert not strange, f"tests/{TESTS[package]} has folders that are no rooms: {strange}"


@pytest.mark.parametrize("package", PACKAGES)
def test_every_room_says_what_it_is_for(package: str):
    for init in (REPO / package).rglob("__init__.py"):
        assert init.read_text().startswith('"""'), init.relative_to(REPO)
