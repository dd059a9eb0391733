"""Where a library of the system is missing, the import of open3d says how to get it."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import pytest

from firstfix_builder.mesh import open3d_core

REPO = Path(__file__).resolve().parents[3]
MISSING = "libEGL.so.1: cannot open shared object file: No such file or directory"


@pytest.mark.parametrize("kind", ["ImportError", "OSError"])
def test_a_missing_library_is_named_with_the_packages_to_install(
    kind: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    (tmp_path / "open3d.py").write_text(f"raise {kind}({MISSING!r})")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "open3d", raising=False)
    with pytest.raises(ImportError) as raised:
        runpy.run_path(open3d_core.__file__)
    said = str(raised.value)
    assert MISSING in said
    setup = (REPO / "scripts/setup.sh").read_text()
    (wanted,) = re.findall(r"^system_packages=\((.*)\)$", setup, re.MULTILINE)
    assert said.endswith(f"apt-get install {wanted}")


def test_a_missing_package_stays_a_missing_package(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    (tmp_path / "open3d.py").write_text("raise ModuleNotFoundError('no open3d', name='open3d')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "open3d", raising=False)
    with pytest.raises(ModuleNotFoundError, match="no open3d"):
        runpy.run_path(open3d_core.__file__)
