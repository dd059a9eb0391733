"""The front door: the release, help, tables, stores that are not there, ports in use."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import firstfix
import firstfix_client
from firstfix.builds.records import new_status
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.catalog.provenance import Provenance
from firstfix.store.store import Store
from firstfix_cli.log_lines import plain_lines
from firstfix_cli.stage_bars import stage_lines
from tests.cli.test_help import nodes
from tests.commands import firstfix as run
from tests.waiting import LIMIT_S

BUILD = "20260302t090500000000-0000000a"


@pytest.fixture
def store(tmp_path: Path) -> str:
    """A store with the map "hall" and a build of it that waits."""
    catalog = Catalog(Store.open(str(tmp_path / "store")))
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "points.bin").write_text("one")
    manifest = Manifest.for_directory(
        tmp_path / "one", sensor={"name": "vlp-16"}, counts={"templates": 7}, bounds=((0, 0, 0), (9, 20, 3))
    )
    made = Provenance(
        "hall.laz", 1234, "ab" * 32, note="a note", caller="user:me", host="pc7", command="make it"
    )
    catalog.publish("hall", tmp_path / "one", manifest, provenance=made)
    catalog.builds.put(BUILD, {"map_id": "hall", "file_name": "hall.laz", "owner": "key:1", "note": "again"})
    return str(tmp_path / "store")


def test_the_program_says_its_release():
    done = subprocess.run(
        [sys.executable, "-m", "firstfix_cli.main", "--version"],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=True,
    )
    assert done.stdout == f"firstfix {firstfix.__version__}\n"
    assert firstfix_client.__version__ == firstfix.__version__


def test_help_is_short_or_long_and_in_words():
    for path, node in nodes():
        short, long = run(*path, "-h").out, run(*path, "--help").out
        assert short == long
        assert node.help.splitlines()[0].split()[0] in short
        usage = short.split("\n\n")[0]
        assert not re.search(r"[{}]|\.\.\.\.", usage), usage
        assert not re.search(r"<(str|int|float|path|list|bool|[a-z]+ range)", short), path


def test_maps_are_a_table(store: str):
    header, line = run("maps", "ls", "--store", store).out.splitlines()
    assert header.split() == ["MAP", "VERSION", "PUBLISHED", "SIZE", "(m)", "SENSOR", "LOCALIZED"]
    assert re.match(r"hall +[0-9a-f]{12} +20\d\d-\d\d-\d\d \d\d:\d\d +9.0 x 20.0 x 3.0 +vlp-16 +-$", line), (
        line
    )


def test_versions_say_what_they_were_made_of(store: str):
    _, line = run("maps", "versions", "hall", "--store", store).out.splitlines()
    assert "hall.laz" in line
    assert line.endswith("user:me  a note")
    version = json.loads(run("maps", "ls", "--store", store, "--json").out)["maps"][0]["active_version"]
    for given in ((), ("--version", version[:5])):
        shown = run("maps", "show", "hall", *given, "--store", store).out
        assert "made of hall.laz, 1,234 bytes, sha256 abababababab" in shown
        assert "by user:me on pc7" in shown
        assert "$ make it" in shown
        assert "note: a note" in shown


@pytest.mark.parametrize(
    "command",
    [
        ("maps", "ls"),
        ("maps", "show", "hall"),
        ("maps", "verify"),
        ("maps", "rebuild", "hall"),
        ("builds", "ls"),
        ("keys", "ls"),
    ],
)
def test_a_store_that_is_not_there_is_an_error(command: tuple[str, ...], tmp_path: Path):
    said = run(*command, "--store", tmp_path / "stroe", code=2)
    assert f"no store at {tmp_path / 'stroe'}: there is no such folder" in said.error
    assert not (tmp_path / "stroe").exists(), "and it is not made"


def test_a_file_that_is_not_there_is_named_with_its_folder(tmp_path: Path):
    path = tmp_path / "maps" / "nomap.pcd"
    build = ("build", path, "--map-id", "a", "--store", tmp_path / "store")
    for command in (("check", path), build, ("localize", path, "--map", "a", "--store", tmp_path)):
        assert f"{path}: no such file" in run(*command, code=2).error
    assert f"{path.parent}: no such file" in run("sensor", path.parent, code=2).error


def test_a_map_is_removed_with_its_name_said_twice(store: str):
    refused = run("maps", "rm", "hall", "--store", store, code=2)
    assert "give --force" in refused.error
    assert run("maps", "rm", "hall", "--store", store, "--force").out == "hall: removed, with 1 version\n"
    assert len(run("maps", "ls", "--store", store).out.splitlines()) == 1, "the header"
    assert "no map hall" in run("maps", "rm", "hall", "--store", store, "--force", code=2).error


def test_builds_are_listed_shown_and_cancelled(store: str):
    header, line = run("builds", "ls", "--store", store).out.splitlines()
    assert header.split()[:4] == ["BUILD", "MAP", "BEGUN", "STATE"]
    assert line.split()[:5] == [BUILD, "hall", "2026-03-02", "09:05", "queued"]
    shown = run("builds", "show", BUILD, "--store", store).out
    assert all(word in shown for word in ("queued", "made of hall.laz", "by key:1", "note: again"))
    assert run("builds", "ls", "--map", "yard", "--store", store, "--json").out == '{"builds": []}\n'
    nothing = run("builds", "ls", "--map", "yard", "--store", store)
    assert len(nothing.out.splitlines()) == 1, "the header"
    assert "no such builds" in nothing.error
    run("builds", "cancel", BUILD, "--store", store)
    assert "was cancelled" in run("builds", "follow", BUILD, "--store", store, code=2).error
    assert "has cancelled" in run("builds", "cancel", BUILD, "--store", store, code=2).error
    assert "no build 20" in run("builds", "show", BUILD[:-1] + "b", "--store", store, code=2).error


def test_a_build_is_followed_to_its_end_and_its_log_is_plain(store: str):
    records = Catalog(Store.open(store)).builds
    status = new_status("succeeded", map_id="hall", stage="publish", progress=1.0, version="ab" * 32)
    records.set_status(BUILD, status)
    records.set_stages(BUILD, [{"stage": "read_map", "seconds": 3.25, "cached": False}])
    followed = run("builds", "follow", BUILD, "--store", store)
    assert f"published hall, version {'ab' * 32}" in followed.out
    assert re.search(r"publish +\d", followed.error), "stages as lines"
    assert re.search(r"read_map +3.2 s", run("builds", "show", BUILD, "--store", store).out)
    assert "has no log" in run("builds", "logs", BUILD, "--store", store, code=2).error
    records.set_log(BUILD, '{"timestamp": "T", "level": "info", "event": "begins", "points": 7}\nplain')
    assert run("builds", "logs", BUILD, "--store", store).out == "T info     begins points=7\nplain\n"


def test_a_trace_in_a_log_keeps_its_lines():
    said = json.dumps({"event": "failed", "exception": "Traceback\n  line"})
    assert list(plain_lines(said))[1:] == ["Traceback", "  line"]


def test_stages_are_lines_with_the_time_of_each(capsys: pytest.CaptureFixture[str]):
    now = [0.0]

    def follow(*told: tuple[str, float, float]) -> None:
        with stage_lines(lambda: now[0]) as show:
            for stage, share, at_s in told:
                now[0] = at_s
                show(stage, share)
            now[0] += 1.5
            if stage == "two":
                raise ValueError

    follow(("queued", 0.0, 0.0), ("one", 0.1, 2.0), ("one", 0.2, 5.0), ("three", 0.9, 10.0))
    assert capsys.readouterr().err.split("\n") == [
        "queued                  2.0 s",
        "one                     8.0 s",
        "three                   1.5 s",
        "",
    ]
    with pytest.raises(ValueError):  # noqa: PT011
        follow(("two", 0.0, 20.0))
    assert capsys.readouterr().err == "two                     1.5 s, not ended\n"


@pytest.mark.parametrize(
    ("command", "option"),
    [
        (("serve", "--host", "127.0.0.1"), "--port"),
        (("worker", "--nats", "nats://127.0.0.1:9"), "--health-port"),
    ],
)
def test_a_port_in_use_has_a_code_and_a_line_of_its_own(
    command: tuple[str, ...], option: str, tmp_path: Path
):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port: Any = taken.getsockname()[1]
        said = run(*command, "--store", tmp_path / "store", option, port, code=6)
    assert (
        f"port {port} of 127.0.0.1 is in use: give another one with {option}" in said.error.splitlines()[-1]
    )


def test_an_address_that_is_not_there_is_said(tmp_path: Path):
    said = run("serve", "--store", tmp_path, "--host", "192.0.2.7", "--port", 8080, code=6)
    assert "cannot listen at port 8080 of 192.0.2.7" in said.error
