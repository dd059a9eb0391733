"""Commands that work on a store or on files, without a service."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
import yaml

from firstfix.builds.config import BuildConfig
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.geopose import Georeference
from firstfix.catalog.georeferences import Georeferences
from firstfix.catalog.manifest import Manifest
from firstfix.catalog.sources import put_source
from firstfix.errors import InvalidOption, NotFound
from firstfix.store.store import Store
from firstfix_cli.answerer import fetch_active_version, is_provisional
from firstfix_cli.build_report import reused_lines
from firstfix_cli.commands.build import Axis, _given
from firstfix_cli.main import run

SELF_TEST = {
    "queries": 3,
    "outside": 1,
    "success": {"0.05m": 0.5},
    "found": 1.0,
    "localized": 1.0,
    "median_error_m": 0.02,
    "false_accepts": 0,
}


def ended(arguments: list[object]) -> int:
    with pytest.raises(SystemExit) as caught:
        run([str(argument) for argument in arguments])
    return int(caught.value.code or 0)


@pytest.fixture
def versions(tmp_path, monkeypatch) -> list[str]:
    """Two published versions of the map "hall" in the store ``tmp_path / "store"``, the second active."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    catalog = Catalog(Store.open(str(tmp_path / "store")))
    found = []
    for content in ("one", "two"):
        files = tmp_path / content
        files.mkdir()
        (files / "points.bin").write_text(content)
        manifest = Manifest.for_directory(
            files, counts={"templates": 7}, self_test=SELF_TEST, sensor={"name": "vlp-16"}
        )
        found.append(catalog.publish("hall", files, manifest))
    return found


def test_maps_of_a_store(versions, tmp_path, capsys):
    store = ["--store", tmp_path / "store"]
    assert ended(["maps", "ls", *store]) == 0
    header, line = capsys.readouterr().out.splitlines()
    assert header.split() == ["MAP", "VERSION", "PUBLISHED", "SIZE", "(m)", "SENSOR", "LOCALIZED"]
    assert line.split()[:2] == ["hall", versions[1][:12]]
    assert line.split()[-2:] == ["vlp-16", "100%"]
    assert ended(["maps", "ls", *store, "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)["maps"]
    assert (told["map_id"], told["active_version"]) == ("hall", versions[1])
    assert told["summary"]["sensor"] == "vlp-16"
    assert ended(["maps", "show", "hall", *store, "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["active_version"] == versions[1]
    assert shown["versions"] == 2
    assert shown["manifest"]["counts"] == {"templates": 7}
    assert ended(["maps", "show", "hall", *store]) == 0
    out = capsys.readouterr().out
    assert f"active {versions[1]}" in out
    assert "7 templates, 0.0 MB, made for vlp-16" in out
    assert "median error 0.020 m" in out
    assert ended(["maps", "versions", "hall", *store]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line[0] for line in lines[1:]] == ["*", " "]
    assert [line[1:].split()[0] for line in lines[1:]] == [version[:12] for version in versions[::-1]]


def test_a_provisional_version_is_marked(tmp_path, capsys):
    (tmp_path / "early").mkdir()
    manifest = Manifest.for_directory(
        tmp_path / "early", counts={"templates": 7}, sensor={"name": "vlp-16"}, provisional=True
    )
    version = Catalog(Store.open(str(tmp_path / "store"))).publish("hall", tmp_path / "early", manifest)
    store = ["--store", tmp_path / "store"]
    assert ended(["maps", "versions", "hall", *store]) == 0
    _, line = capsys.readouterr().out.splitlines()
    assert line.split()[:2] == ["*", version[:12]]
    assert "provisional" in line
    assert ended(["maps", "versions", "hall", *store, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["versions"][0]["provisional"] is True
    assert ended(["maps", "show", "hall", *store]) == 0
    assert "provisional: coarse and little tested" in capsys.readouterr().out
    assert is_provisional(str(tmp_path / "store"), "hall", version)


def test_what_was_reused_is_one_line():
    stages = [
        {"stage": "read_map", "cached": True, "chunks": 0, "chunks_reused": 0},
        {"stage": "make_templates", "cached": False, "chunks": 1200, "chunks_reused": 1100},
        {"stage": "self_test", "cached": False},
    ]
    said = "reused from earlier builds: read_map, 1,100 of 1,200 chunks of make_templates"
    assert reused_lines(stages) == [said]
    assert reused_lines(stages[2:]) == []


def test_a_store_rolls_back(versions, tmp_path, capsys):
    store = ["--store", tmp_path / "store"]
    assert ended(["maps", "activate", "hall", versions[0][:12], *store]) == 0
    assert versions[0] in capsys.readouterr().out
    assert fetch_active_version(str(tmp_path / "store"), "hall")[0] == versions[0]
    version, directory = fetch_active_version(str(tmp_path / "store"), "hall", versions[1])
    assert version == versions[1]
    assert (directory / "points.bin").read_text() == "two"


def test_a_store_retires_rolls_back_and_is_cleaned(versions, tmp_path, capsys):
    store = ["--store", tmp_path / "store"]
    assert ended(["maps", "rollback", "hall", *store]) == 0
    assert f"version {versions[0]} is active" in capsys.readouterr().out
    assert ended(["maps", "retire", "hall", versions[0][:10], *store]) != 0
    assert "is active" in capsys.readouterr().err
    assert ended(["maps", "retire", "hall", versions[1][:10], *store]) == 0
    assert ended(["maps", "rollback", "hall", *store]) != 0
    orphan = tmp_path / "store/maps/hall/versions" / ("0" * 64) / "a.bin"
    orphan.parent.mkdir()
    orphan.write_bytes(b"of a publish that was killed")
    os.utime(orphan, (0, 0))
    capsys.readouterr()
    assert ended(["maps", "gc", "--dry-run", *store, "--json"]) == 0
    would = json.loads(capsys.readouterr().out)
    assert (would["dry_run"], would["objects"]["versions"]) == (True, 1)
    assert orphan.exists()
    assert ended(["maps", "gc", "hall", *store]) == 0
    assert "versions" in capsys.readouterr().out
    assert not orphan.exists()


@pytest.mark.parametrize("command", [["show", "yard"], ["versions", "yard"], ["activate", "yard", "a" * 64]])
def test_a_map_that_is_not_there(versions, tmp_path, capsys, command):
    assert ended(["maps", *command, "--store", tmp_path / "store"]) == 2
    assert "no map yard" in capsys.readouterr().err


@pytest.mark.parametrize("command", [["show", "hal"], ["versions", "hallo"], ["activate", "halls", "a" * 64]])
def test_a_misspelt_map_is_told_its_name(versions, tmp_path, capsys, command):
    assert ended(["maps", *command, "--store", tmp_path / "store"]) == 2
    assert f"no map {command[1]}: did you mean hall?" in capsys.readouterr().err
    with pytest.raises(NotFound, match="did you mean hall"):
        fetch_active_version(str(tmp_path / "store"), command[1])


def test_a_map_without_an_active_version(tmp_path):
    with pytest.raises(NotFound, match="hall"):
        fetch_active_version(str(tmp_path), "hall")


def test_url_and_store_together_are_refused(capsys):
    assert ended(["maps", "ls", "--url", "http://127.0.0.1:9", "--store", "/tmp/x"]) == 2
    assert "one of --url and --store" in capsys.readouterr().err


def test_serve_takes_the_environment_under_the_command_line(monkeypatch, tmp_path):
    from firstfix_cli.commands.serve import settings_of

    nothing = {"store": None, "host": None, "port": None, "zenoh": None, "zenoh_listen": None, "work": None}
    monkeypatch.setenv("FIRSTFIX_STORE", "/from/environment")
    monkeypatch.setenv("FIRSTFIX_PORT", "1234")
    plain = settings_of(**nothing)
    assert (plain.store, plain.port, plain.zenoh_enabled) == ("/from/environment", 1234, False)
    given = settings_of(**nothing | {"port": 99, "zenoh_listen": ["tcp/127.0.0.1:7447"]})
    assert (given.port, given.zenoh_enabled, given.zenoh_listen) == (99, True, ("tcp/127.0.0.1:7447",))
    assert settings_of(**nothing | {"zenoh": tmp_path / "z.json5"}).zenoh_config == tmp_path / "z.json5"
    assert settings_of(**nothing | {"work": tmp_path}).work_dir == tmp_path
    with pytest.raises(InvalidOption, match="port"):
        settings_of(**nothing | {"port": 99_999})
    monkeypatch.delenv("FIRSTFIX_STORE")
    with pytest.raises(InvalidOption, match="store"):
        settings_of(**nothing)


@pytest.mark.parametrize(("wanted", "size_bytes"), [(None, 5), (True, 100 << 30), (False, 0)])
def test_a_worker_shares_stages_as_it_is_told(wanted: bool | None, size_bytes: int, monkeypatch):
    pytest.importorskip("firstfix_service.settings")
    from firstfix_cli.commands.serve import settings_of

    monkeypatch.setenv("FIRSTFIX_SHARED_STAGES_MAX_BYTES", "5")
    assert settings_of(store="memory://", share_stages=wanted).shared_stages_bytes == size_bytes


def _config(path: Path | None, sensor: str | None, axis: Axis | None) -> BuildConfig:
    return BuildConfig.parse(_given(path, sensor, axis))


def test_the_command_line_goes_over_the_config_file(tmp_path):
    path = tmp_path / "build.yaml"
    path.write_text("sensor: vlp-16\naxis: y-up\nviewpoints: {spacing_m: 2.5}\n")
    plain = _config(path, None, None)
    assert (plain.sensor, plain.axis, plain.viewpoints.spacing_m) == ("vlp-16", "y-up", 2.5)
    overridden = _config(path, "OS0-64", Axis.z_up)
    assert (overridden.sensor_model.name, overridden.axis) == ("os0-64", "z-up")
    assert overridden.viewpoints.spacing_m == 2.5
    sensor = tmp_path / "sensor.yaml"
    sensor.write_text(yaml.safe_dump({"preset": "vlp-16", "name": "mine", "mount_height_m": 0.4}))
    assert _config(None, str(sensor), None).sensor_model.mount_height_m == 0.4


def test_configs_that_cannot_be_used_are_clear(tmp_path):
    with pytest.raises(NotFound, match=r"nothere\.yaml"):
        _config(tmp_path / "nothere.yaml", None, None)
    with pytest.raises(NotFound, match=r"sensor\.yaml"):
        _config(None, str(tmp_path / "sensor.yaml"), None)
    (tmp_path / "sensor.yaml").write_text("{")
    with pytest.raises(InvalidOption, match=r"sensor\.yaml"):
        _config(None, str(tmp_path / "sensor.yaml"), None)
    with pytest.raises(InvalidOption, match="no sensor preset"):
        _config(None, "vlp-17", None)


def test_an_unknown_world_is_refused(tmp_path, capsys):
    assert ended(["world", "atlantis", "-o", tmp_path]) == 2
    assert "no world 'atlantis'" in capsys.readouterr().err


def test_maps_are_built_again_and_stores_copied(versions, tmp_path, capsys):
    store = Store.open(str(tmp_path / "store"))
    catalog = Catalog(store)
    assert ended(["maps", "rebuild", "hall", "--store", tmp_path / "store"]) == 2
    assert "submit the map again" in capsys.readouterr().err
    (tmp_path / "cloud.xyz").write_text("0 0 0")
    key = f"maps/hall/sources/{put_source(catalog.store, 'hall', tmp_path / 'cloud.xyz')}"
    catalog.builds.put("b1", {"map_id": "hall", "source": {"key": key}, "trajectory": None, "config": {}})
    files = tmp_path / "three"
    files.mkdir()
    catalog.publish("hall", files, Manifest.for_directory(files), build_id="b1")
    assert ended(["maps", "rebuild", "hall", "--store", tmp_path / "store"]) == 0
    (build_id,) = set(catalog.builds.ids()) - {"b1"}
    assert build_id in capsys.readouterr().out
    assert ended(["maps", "patch", "hall", "--store", tmp_path / "store"]) == 2
    assert "patches of map hall are off" in capsys.readouterr().err
    assert ended(["maps", "patch", "hall", "--mode", "propose", "--store", tmp_path / "store", "--json"]) == 0
    asked = json.loads(capsys.readouterr().out)
    assert catalog.builds.request(asked["build_id"])["patch"]["mode"] == "propose"
    assert ended(["copy-store", tmp_path / "store", tmp_path / "copy", "--json"]) == 0
    copied = json.loads(capsys.readouterr().out)
    assert copied["damaged"] == []
    assert Catalog(Store.open(str(tmp_path / "copy"))).builds.ids() == catalog.builds.ids()


def test_a_copy_with_another_history_has_an_exit_code_of_its_own(versions, tmp_path, capsys):
    for name, latitude_deg in (("store", 47.0), ("copy", 48.0)):
        store = Store.open(str(tmp_path / name))
        Georeferences(store).set("hall", Georeference(latitude_deg, 11.0, 0.0, (0.0, 0.0, 0.0, 1.0)))
    assert ended(["copy-store", tmp_path / "store", tmp_path / "copy", "--json"]) == 5
    said = capsys.readouterr()
    assert json.loads(said.out)["conflicts"] == ["maps/hall/georeference/000001.json"]
    assert "maps/hall/georeference/000001.json" in said.err
    assert Catalog(Store.open(str(tmp_path / "copy"))).active_version("hall") == versions[1]


def test_a_store_is_verified_and_repaired(versions, tmp_path, capsys):
    store = Store.open(str(tmp_path / "store"))
    place = ["--store", tmp_path / "store"]
    assert ended(["maps", "verify", *place]) == 0
    assert "0 mended, 0 damaged" in capsys.readouterr().out
    damaged = f"maps/hall/versions/{versions[1]}/points.bin"
    store.put(damaged, b"owt")
    store.put("builds/b1/request.json", b"{")
    assert ended(["maps", "verify", *place]) == 2
    said = capsys.readouterr().out
    assert damaged in said
    assert "the build_request" in said
    assert "0 mended, 2 damaged" in said
    assert store.exists("builds/b1/request.json"), "only --repair changes anything"
    assert ended(["maps", "verify", *place, "--repair", "--json"]) == 2
    found = {entry["key"]: entry["mended"] for entry in json.loads(capsys.readouterr().out)["findings"]}
    assert found[damaged] == ""
    assert "quarantine/" in found["builds/b1/request.json"]
    cache = tmp_path / "fetched" / versions[1]
    cache.mkdir(parents=True)
    (cache / "points.bin").write_text("two")
    assert ended(["maps", "verify", *place, "--repair", "--cache", tmp_path / "fetched"]) == 0
    assert "1 mended, 0 damaged" in capsys.readouterr().out
    assert ended(["maps", "verify", *place]) == 0
