"""Wrong maps over the command line and HTTP: each is told by its cause, and no process takes much memory.

``WRITE=1 pytest tests/e2e/test_wrong_maps.py`` writes the table anew, of which ``make docs`` makes the
page of wrong maps.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from firstfix_cli.local_service import local_service
from firstfix_cli.main import run
from tests.e2e.wrong_maps import PNG, WRONG_MAPS, Points, npy, written

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

TABLE = Path(__file__).with_name("wrong_maps.json")
MAP_POINTS = 150_000
MAX_BYTES = 1 << 30
# Its own peak: that of wait4 counts the test's process too, of which it is a fork before it loads a program.
COMMAND = """
import atexit, resource, sys
from firstfix_cli.main import run

def print_peak():
    own = next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmHWM:"))
    print(max(own, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss))

atexit.register(print_peak)
run(sys.argv[1:])
"""
FOREIGN_WORDS = ("Value error", "Traceback", "could not convert", "memory-mapped", "Field required", "numpy")
Row = dict[str, str]


@pytest.fixture(scope="module")
def right(small_world) -> Points:
    import trimesh

    mesh = trimesh.Trimesh(small_world.vertices, small_world.triangles, process=False)
    return np.asarray(trimesh.sample.sample_surface(mesh, MAP_POINTS, seed=1)[0])


def said(arguments: list[str], folder: Path, capsys: pytest.CaptureFixture[str]) -> Row:
    """The first finding of a command, or its error."""
    with pytest.raises(SystemExit) as ended:
        run([*arguments, *(["--json"] if arguments[0] == "check" else [])])
    out, error = capsys.readouterr()
    if out:
        found = json.loads(out)["files"][0]["findings"][0]
        answer = "refused" if found["severity"] == "error" else found["severity"]
        assert ended.value.code == (2 if answer == "refused" else 0)
        return {"answer": answer, "code": found["code"], "text": found["text"], "remedy": found["remedy"]}
    assert ended.value.code == 2
    text, _, more = error.replace(f"{folder}/", "").strip().removeprefix("firstfix: ").partition("\n")
    text = text if text.endswith((".", "?")) else f"{text}."
    return {"answer": "error", "text": text, **({"remedy": more.strip()} if more else {})}


def test_wrong_maps_are_named(right, tmp_path, capsys, monkeypatch):
    monkeypatch.delenv("FIRSTFIX_STORE", raising=False)
    table = []
    for number, wrong in enumerate(WRONG_MAPS):
        folder = tmp_path / str(number)
        row = said(written(wrong, right, folder), folder, capsys)
        assert not [word for word in FOREIGN_WORDS if word in row["text"]], wrong.name
        table.append({"input": wrong.name, "command": row})
    if os.environ.get("WRITE"):
        TABLE.write_text(json.dumps(table, indent=1) + "\n")
    kept = json.loads(TABLE.read_text())
    assert [told(row) for row in table] == [told(row) for row in kept]


def told(row: dict[str, Row]) -> tuple[object, ...]:
    """A row of the table without the sentences, whose numbers may differ in the last digit."""
    return row["input"], row["command"]["answer"], row["command"].get("code")


def test_the_right_map_has_no_finding(right: Points, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "map.npy").write_bytes(npy(right))
    run_ended(["check", str(tmp_path / "map.npy")], 0)
    assert "nothing found" in capsys.readouterr().out
    (tmp_path / "mm.npy").write_bytes(npy(1000 * right))
    run_ended(["check", str(tmp_path / "mm.npy"), "--scale", "0.001"], 0)
    assert "nothing found" in capsys.readouterr().out


def test_a_scan_with_its_intensity_first_is_named(right, tmp_path, capsys):
    (tmp_path / "map.npy").write_bytes(npy(right))
    (tmp_path / "scan.npy").write_bytes(npy(np.column_stack([np.arange(len(right)) % 97, right])[:3000]))
    run_ended(["check", str(tmp_path / "map.npy"), str(tmp_path / "scan.npy"), "--json"], 2)
    of_map, of_scan = json.loads(capsys.readouterr().out)["files"]
    assert [finding["code"] for finding in of_scan["findings"]] == ["columns_shifted"]
    assert not of_map["findings"]


def run_ended(arguments: list[str], code: int) -> None:
    with pytest.raises(SystemExit) as ended:
        run(arguments)
    assert ended.value.code == code


def test_a_build_refuses_a_map_in_millimetres_before_it_takes_memory(right: Points, tmp_path: Path):
    (tmp_path / "mm.npy").write_bytes(npy(1000 * right))
    options = ["--map-id", "yard", "--store", str(tmp_path / "store"), "--work", str(tmp_path / "work")]
    began = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", COMMAND, "build", str(tmp_path / "mm.npy"), *options],
        capture_output=True,
        text=True,
        check=False,
    )
    peak_kib, error = int(done.stdout), done.stderr
    print(f"{peak_kib / 1e3:.0f} MB, {time.monotonic() - began:.1f} s")
    assert done.returncode == 2
    assert "is its unit the millimetre? Give --scale 0.001" in error
    assert "docs/how-to/my-map.md" in error
    assert 1024 * peak_kib < MAX_BYTES, "of the largest of its processes"


def test_a_service_names_wrong_maps_too(right: Points, tmp_path: Path):
    from firstfix.errors import FirstfixError
    from firstfix_client import Client

    with local_service(tmp_path / "service", tmp_path / "store") as service, Client(service.url) as client:
        for name, content, text in (
            ("mm.npy", npy(1000 * right), "is its unit the millimetre? Give --scale 0.001"),
            ("map.pcd", PNG, "it is a PNG image"),
        ):
            (tmp_path / name).write_bytes(content)
            build = client.build_map(tmp_path / name, "yard")
            with pytest.raises(FirstfixError) as failed:
                client.wait_for_build(build.build_id)
            assert text in str(failed.value)
        assert client.maps() == []
