"""What ``firstfix serve`` says of a store without maps."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix_cli.commands.serve import new_store
from firstfix_cli.main import run


def test_a_store_that_is_new_or_empty_is_named_with_its_folder(tmp_path: Path):
    typo = tmp_path / "typo"
    assert new_store(str(typo)) == (
        f"the store is empty and new: the folder {typo} is made now. Is the path right?"
    )
    typo.mkdir()
    assert new_store(f"file://{typo}") == (
        f"the store is empty: the folder {typo} has no map. Is the path right?"
    )
    (typo / "maps").mkdir()
    assert new_store(str(typo)) is None
    assert new_store("s3://maps/firstfix") is None, "a bucket is not looked at before the service runs"


def test_no_store_is_told_in_plain_words(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("FIRSTFIX_STORE", raising=False)
    with pytest.raises(SystemExit) as ended:
        run(["serve"])
    assert ended.value.code == 2
    assert "give the store of maps: --store DIR, or FIRSTFIX_STORE" in capsys.readouterr().err
