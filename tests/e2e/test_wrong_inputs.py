"""Wrong inputs over the command line and HTTP: each is told by its cause, none is localized at a wrong place.

``WRITE=1 pytest tests/e2e/test_wrong_inputs.py`` writes the table anew, of which ``make docs`` makes
the page of wrong inputs.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.scan_formats import SUFFIXES
from firstfix.store.store import Store
from firstfix.transform import pose_error, pose_from_mapping
from firstfix_cli.commands.localize import EXIT_CODES
from firstfix_cli.local_service import LocalService, local_service
from firstfix_cli.main import run
from tests.e2e.wrong_inputs import WRONG_INPUTS, RightScan, kitti, ply, written
from tests.waiting import LIMIT_S

pytestmark = pytest.mark.timeout(600)

TABLE = Path(__file__).with_name("wrong_inputs.json")
Row = dict[str, Any]


@pytest.fixture(scope="module")
def right(small_world, small_scans) -> RightScan:
    return RightScan.of(small_world, small_scans)


@pytest.fixture(scope="module")
def service(small_version, tmp_path_factory) -> Iterator[LocalService]:
    root = tmp_path_factory.mktemp("wrong")
    catalog = Catalog(Store.open(str(root / "store")))
    catalog.publish("yard", small_version.directory, small_version.manifest)
    with local_service(root / "service", root / "store") as running:
        yield running


def by_command(service: LocalService, path: Path, options: dict[str, str], capsys) -> Row:
    """The answer of ``firstfix localize``, or its error."""
    given = [f"--{name.replace('_', '-')}={value}" for name, value in options.items()]
    with pytest.raises(SystemExit) as ended:
        run(["localize", str(path), "--map", "yard", "--url", service.url, "--json", *given])
    out, error = capsys.readouterr()
    if ended.value.code == 2:
        return said(error.split(f"{path}: ")[-1].strip())
    row = row_of(json.loads(out))
    assert ended.value.code == EXIT_CODES[row["answer"].split()[0]]
    return row


def by_http(service: LocalService, path: Path, options: dict[str, str]) -> Row:
    """The answer of ``POST /localize`` to the bytes of the file, or its problem."""
    answer = httpx.post(
        f"{service.url}/localize",
        params={"map": "yard", **options},
        headers={"Content-Type": SUFFIXES[path.suffix]},
        content=path.read_bytes(),
        timeout=LIMIT_S,
    )
    if answer.status_code != 200:
        assert 400 <= answer.status_code < 500, answer.text
        return said(answer.json()["detail"])
    return row_of(answer.json())


def said(text: str) -> Row:
    return {"answer": "error", "code": "", "text": text, "remedy": ""}


def row_of(answer: Row) -> Row:
    found = answer["findings"]
    reason = f" ({answer['reasons'][0]})" if answer["reasons"] else ""
    return {
        "answer": answer["verdict"] + reason,
        "code": found[0]["code"] if found else "",
        "text": found[0]["text"] if found else "",
        "remedy": found[0]["remedy"] if found else "",
        "T_map_sensor": answer["T_map_sensor"],
    }


def test_wrong_inputs_are_named(service, right, tmp_path, capsys):
    table = []
    for wrong in WRONG_INPUTS:
        path, options = written(wrong, right, tmp_path), dict(wrong.options(right))
        rows = {"command": by_command(service, path, options, capsys)}
        if wrong.by_http:
            rows["http"] = by_http(service, path, options)
        for way, row in rows.items():
            assert row["text"], f"{wrong.name}: nothing is said, {way}"
            assert is_right_or_none(row, right), f"{wrong.name}: localized at a wrong place, {way}"
        table.append({"input": wrong.name, **{way: shown(row) for way, row in rows.items()}})
    if os.environ.get("WRITE"):
        TABLE.write_text(json.dumps(table, indent=1) + "\n")
    for row, kept in zip(table, json.loads(TABLE.read_text()), strict=True):
        assert told(row) == told(kept)


def test_columns_shifted_by_an_intensity_are_named(service, right, tmp_path):
    first = np.arange(len(right.points)) % 97 / 96
    path = tmp_path / "scan.bin"
    path.write_bytes(kitti(np.column_stack([first, right.points[:, :2]]), right.points[:, 2]))
    row = by_http(service, path, {})
    assert row["code"] == "columns_shifted"
    assert "fits" in row["text"]


def is_right_or_none(row: Row, right: RightScan) -> bool:
    """Returns whether an input that is localized all the same is at the right place."""
    if row.get("T_map_sensor") is None:
        return True
    off_m, _ = pose_error(right.T_map_sensor, pose_from_mapping(row["T_map_sensor"]))
    return off_m < 0.2


def shown(row: Row) -> Row:
    return {name: row[name] for name in ("answer", "code", "text", "remedy") if row[name]}


def told(row: Row) -> Row:
    """A row of the table without the sentences, whose numbers may differ in the last digit."""
    ways = {way: row[way] for way in ("command", "http") if way in row}
    return {way: (row["input"], one["answer"], one.get("code")) for way, one in ways.items()}


def test_the_right_scan_is_localized_without_a_finding(service, right, tmp_path, capsys):
    path = tmp_path / "right.ply"
    path.write_bytes(ply(right.points))
    row = by_command(service, path, {}, capsys)
    assert (row["answer"], row["code"]) == ("localized", "")
    with pytest.raises(SystemExit):
        run(["localize", str(path), "--map", "yard", "--url", service.url, "--prior", "0,0,0.8,0.5"])
    said = capsys.readouterr().out
    assert "remedy  " in said
    assert "my-scan-is-not-localized.md" in said
