"""Damages each object of a small store in turn: a flipped bit, cut off, missing. Then looks who notices.

    firstfix-lab rot [--bits N | --all] [--seed N] [--root PATH] [--json FILE]

Each damage is tried alone. ``maps verify`` must name it, or nothing reads differently (harmless). No reader
may get a false value (wrong). A backup and the restoration from one must go on with everything else. Last,
bits are flipped in the files of a version that is loaded, as a running service has them mapped.

Nobody can tell that an object is missing if no other one names it, nor that a part of an upload under way has
a wrong bit: these rows are in the table, but are no failure. A restoration brings back what is missing.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import subprocess
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import FILE_NAME
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.errors import FirstfixError
from firstfix.maintenance.backup import copy_store
from firstfix.maintenance.record_kinds import form_of
from firstfix.maintenance.verify import Verification
from firstfix.store.store import Store
from firstfix_lab.checkout import ROOT

from .rot_store import ABSENT, built_store, fill, look

COLUMNS = ("tried", "named", "harmless", "missed", "wrong", "stopped", "not restored")
LASTS = ("maps/", "builds/", "keys/")  # what a backup holds
WRONG_M = 0.1


@dataclass
class Table:
    """Counts by kind of object and of damage.

    Attributes:
        examples: what was missed, wrong, stopped or not restored.
    """

    rows: dict[str, Counter[str]] = field(default_factory=dict)
    examples: list[str] = field(default_factory=list)

    def add(self, row: str, results: Sequence[str], example: str) -> None:
        counts = self.rows.setdefault(row, Counter())
        counts.update(("tried", *results))
        if set(results) - {"named", "harmless"}:
            self.examples.append(f"{row}: {', '.join(results)}: {example}")

    def total(self, column: str) -> int:
        return sum(counts[column] for counts in self.rows.values())

    @property
    def failures(self) -> int:
        """Damage that were missed or gave a false value although somebody could tell, or stopped a copy."""
        known = [c for row, c in self.rows.items() if not row.endswith("missing") and "under way" not in row]
        return self.total("stopped") + sum(counts["missed"] + counts["wrong"] for counts in known)

    def __str__(self) -> str:
        lines = [f"{'kind':40}" + "".join(f"{name:>13}" for name in COLUMNS)]
        for row in sorted(self.rows):
            lines.append(f"{row:40}" + "".join(f"{self.rows[row][name]:13,}" for name in COLUMNS))
        lines.append(f"{'all':40}" + "".join(f"{self.total(name):13,}" for name in COLUMNS))
        return "\n".join(lines)


class Rot:
    """The drill over one store.

    Args:
        store: the objects to begin with; it is only read.
        bits: flipped in each object, one after the other; 0: all.
    """

    def __init__(self, store: Store, scratch: Path, *, bits: int, seed: int) -> None:
        self._objects = {key: store.get(key) for key in store.list()}
        self._scratch = scratch
        self._bits = bits
        self._rng = random.Random(seed)
        self.table = Table()
        self._right = self._look(self._objects)

    def run(self, keys: Sequence[str] | None = None) -> Table:
        """Damage each object in turn, or some of them."""
        for key in self._objects if keys is None else keys:
            for damage, data in self._damages(self._objects[key]):
                changed = dict(self._objects)
                if data is None:
                    del changed[key]
                else:
                    changed[key] = data
                self.table.add(f"{kind_of(key)}, {damage}", self._try(key, changed), key)
        return self.table

    def one_of_each_kind(self) -> list[str]:
        found: dict[str, str] = {}
        for key in self._objects:
            found[kind_of(key)] = key  # the last one
        return list(found.values())

    def _damages(self, data: bytes) -> Iterator[tuple[str, bytes | None]]:
        count = 8 * len(data)
        for bit in range(count) if not self._bits else self._rng.sample(range(count), min(self._bits, count)):
            yield "flipped", flipped(data, bit)
        if data:
            yield "cut off", data[: len(data) // 2]
            yield "cut off", data[:-1]
        yield "missing", None

    def _try(self, key: str, objects: dict[str, bytes]) -> list[str]:
        named = any(unit_of(finding.key) == unit_of(key) for finding in verified(objects))
        lost, false = differences(self._right, self._look(objects))
        results = ["wrong" if false else "named" if named else "missed" if lost else "harmless"]
        if key.startswith(LASTS) and "/sightings/" not in key:
            results += self._backed_up(key, objects)
        return results

    def _backed_up(self, key: str, objects: dict[str, bytes]) -> list[str]:
        """Copy the damaged store, and restore it from a copy of the right one."""
        damaged, backup = in_memory(objects), Store.open("memory://")
        # Without its log's entry nobody knows that a version is published: then all of its map waits.
        own = "/".join(key.split("/")[:2]) if "/log/" in key else unit_of(key)
        others = [
            other
            for other in self._objects
            if other.startswith(LASTS) and "/sightings/" not in other and not other.startswith(own)
        ]
        try:
            copy_store(damaged, backup)
            copied = {found: backup.get(found) for found in backup.list()}
            if any(copied.get(other) != self._objects[other] for other in others):
                return ["stopped"]
            copy_store(in_memory(self._objects), damaged)
        except FirstfixError:
            return ["stopped"]
        is_back = damaged.exists(key) and damaged.get(key) == self._objects[key]
        return [] if is_back else ["not restored"]

    def _look(self, objects: dict[str, bytes]) -> dict[str, Any]:
        with tempfile.TemporaryDirectory(dir=self._scratch) as folder:
            return look(in_memory(objects), Path(folder))


def in_memory(objects: dict[str, bytes]) -> Store:
    store = Store.open("memory://")
    for key, data in objects.items():
        store.put(key, data)
    return store


def verified(objects: dict[str, bytes]) -> Sequence[Any]:
    return Verification(in_memory(objects)).run().findings


def differences(right: dict[str, Any], now: dict[str, Any]) -> tuple[list[str], list[str]]:
    """Names of things that are lost, and of things with a value that was never right."""
    lost: list[str] = []
    false: list[str] = []
    for name, value in right.items():
        found = now.get(name, ABSENT)
        if found == value or (name == "stage" and found == ABSENT):
            continue
        is_part = isinstance(found, frozenset) and found < value
        is_older = name.startswith("active ") and found in right[name.replace("active", "versions")]
        (lost if found == ABSENT or is_part or is_older or is_empty(name, found) else false).append(name)
    # An older version is served from files of its own, which are read and compared like those of any version.
    false += [name for name in now.keys() - right.keys() if not name.startswith("files ")]
    return lost, false


def is_empty(name: str, found: Any) -> bool:
    """Whether it is as if the object were not there: queued, none, or 0."""
    if name.startswith("status "):
        return bool(found["state"] == "queued")
    return found is None or found in ([], 0.0)


def kind_of(key: str) -> str:
    form = form_of(key)
    if form is not None:
        return str(form.kind.value)
    parts = key.split("/")
    if key.endswith(FILE_NAME):
        return "manifest"
    if "sources" in parts:
        return "source"
    if parts[0] == "uploads":
        return "part of an upload under way" if parts[1] == "half" else "part of a whole upload"
    known = {
        "maps": "version file",
        "recorded-queries": "body of a recorded query",
        "stages": "file of a shared stage",
    }
    return known.get(parts[0], f"marker in {parts[0]}")


def unit_of(key: str) -> str:
    """The thing to which an object belongs: a version, an upload, a recorded query, a build, a map's log."""
    parts = key.split("/")
    if parts[0] == "maps":
        return "/".join(parts[:4] if parts[2] == "versions" else parts)
    if parts[0] in ("uploads", "builds", "stages"):
        return "/".join(parts[:2])
    return key.rpartition(".")[0] if parts[0] in ("recorded-queries", "keys") else key


def flipped(data: bytes, bit: int) -> bytes:
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def rot_while_serving(store: Store, scratch: Path, table: Table, *, bits: int, seed: int) -> None:
    """Flip bits in the files of a loaded version, and ask for a pose each time."""
    from firstfix.builds.config import PerturbConfig
    from firstfix.sensor import SensorModel
    from firstfix_builder.simulation.perturb import perturbed_scans
    from firstfix_builder.simulation.simulate import Simulator
    from tests.small_world import SENSOR, yard

    catalog = Catalog(store)
    version = str(catalog.active_version("yard"))
    right = catalog.fetch_version("yard", version, scratch / "fetched")
    folder = scratch / "mapped"
    shutil.copytree(right, folder)
    index = MapIndex.load(folder)
    localizer, rng = Localizer(index), random.Random(seed)
    world = yard()
    (scan, T_map_sensor), *_ = perturbed_scans(
        Simulator(world.vertices, world.triangles),
        SensorModel.from_mapping(SENSOR),
        index.cascade.templates.position_m,
        1.0,
        1,
        PerturbConfig(occluders=0, unmapped=0, vanished=0),
        np.random.default_rng(seed),
    )
    manifest = catalog.manifest("yard", version)
    for name, entry in sorted(manifest.query_files.items()):
        with (folder / name).open("r+b") as file:
            for bit in rng.sample(range(8 * entry.bytes), min(bits, 8 * entry.bytes)):
                file.seek(bit // 8)
                byte = file.read(1)[0]
                patch(file, bit // 8, byte ^ 1 << bit % 8)
                try:
                    answer = localizer.localize(scan)
                    T_found = answer.T_map_sensor
                    away_m = (
                        0.0 if T_found is None else float(np.linalg.norm((T_found - T_map_sensor)[:3, 3]))
                    )
                    result = (
                        "wrong" if answer.verdict.value == "localized" and away_m > WRONG_M else "harmless"
                    )
                except FirstfixError:
                    result = "named"
                except Exception:
                    result = "named" if is_noticed(manifest, folder, scratch) else "missed"
                patch(file, bit // 8, byte)
                table.add(f"mapped {name}, flipped", [result], f"bit {bit}")


def is_noticed(manifest: Any, folder: Path, scratch: Path) -> bool:
    """Whether the service finds the damage: it reads the files again after an unexpected error."""
    try:
        from firstfix.catalog.versions.cache import check_again
    except ImportError:  # releases before
        return False
    try:
        check_again(manifest, folder, scratch)
    except FirstfixError:
        return True
    return False


def patch(file: Any, at: int, byte: int) -> None:
    file.seek(at)
    file.write(bytes([byte]))
    file.flush()


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="firstfix-lab rot", description=__doc__.split("\n\n")[0])
    parser.add_argument("--bits", type=int, default=8, help="flipped in each object, one after the other")
    parser.add_argument("--all", action="store_true", help="all bits of each object")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--root", type=Path, help="another checkout, with a .venv, whose code is tried")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the table here")
    chosen = parser.parse_args(arguments)
    if chosen.root:
        rest = [word for word in arguments if word not in ("--root", str(chosen.root))]
        line = [chosen.root / ".venv/bin/python", "-m", "firstfix_lab", "rot", *rest]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "lab")])}
        return subprocess.run(line, env=environment, check=False).returncode
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        store = built_store(folder)
        fill(store, folder / "made")
        drill = Rot(store, folder, bits=0 if chosen.all else chosen.bits, seed=chosen.seed)
        table = drill.run()
        rot_while_serving(store, folder, table, bits=chosen.bits, seed=chosen.seed)
    print("\n".join(table.examples), table, sep="\n\n")
    if chosen.json:
        chosen.json.write_text(json.dumps({row: dict(counts) for row, counts in table.rows.items()}) + "\n")
    return 1 if table.failures else 0
