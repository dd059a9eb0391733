"""Versions of libraries in the keys of stages, held against what the code of each stage imports."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path

import pytest

import firstfix
import firstfix_builder
from firstfix.builds.options import STAGES
from firstfix_builder.execution import library_versions
from firstfix_builder.execution.library_versions import libraries_of, version_of
from firstfix_builder.execution.stage_cache import StageCache
from firstfix_builder.sources.read_source import readers

ROOTS = {one.__name__: Path(one.__file__).parent for one in (firstfix, firstfix_builder)}
READERS = ("patch", "archive", "sessions", "map")
# They store, configure and watch a build, read values that are in the key, or draw.
OTHERS = {"PIL", "distributed", "obstore", "opentelemetry", "pydantic", "threadpoolctl", "yaml"}
# Imported beside the classes of files that these stages read and write, and not called by them.
NOT_CALLED = {
    "faiss": set(STAGES) - {"read_map", "build_index", "self_test"},
    "open3d": {"fit_engine", "draw_cloud"},
}
LIBRARIES = {"faiss", "laspy", "lazrs", "lzf", "numpy", "open3d", "pye57", "scipy", "trimesh", "zstandard"}


def file_of(module: str) -> Path | None:
    top, _, rest = module.partition(".")
    if top not in ROOTS:
        return None
    path = ROOTS[top].joinpath(*rest.split(".")) if rest else ROOTS[top]
    found = (path.with_suffix(".py"), path / "__init__.py")
    return next((one for one in found if one.is_file()), None)


def imported(node: ast.AST, package: str) -> Iterator[tuple[str, str]]:
    """Yields the modules that are imported below a node, also late ones, with the names that they get."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING":
            continue
        if isinstance(child, ast.Import):
            yield from ((one.name, one.asname or one.name) for one in child.names)
        elif isinstance(child, ast.ImportFrom):
            parts = package.split(".")
            above = parts[: len(parts) - child.level + 1] if child.level else []
            base = ".".join([*above, *([child.module] if child.module else [])])
            for one in child.names:
                inner = f"{base}.{one.name}"
                yield (inner if file_of(inner) else base), one.asname or one.name
        else:
            yield from imported(child, package)


@cache
def imports_of(module: str) -> tuple[str, ...]:
    path = file_of(module)
    assert path is not None
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    return tuple(name for name, _ in imported(ast.parse(path.read_text()), package))


def libraries_behind(modules: set[str]) -> set[str]:
    """The libraries that these modules import, and those that they import in turn."""
    seen: set[str] = set()
    todo, found = list(modules), set()
    while todo:
        module = todo.pop()
        if file_of(module) is None:
            found.add(module.partition(".")[0])
        elif module not in seen:
            seen.add(module)
            todo += imports_of(module)
    return found & LIBRARIES


def stages_with_modules() -> Iterator[tuple[str, set[str]]]:
    """Yields the stages that the methods of ``BuildStages`` make, with the modules that each method uses."""
    yield "read_map", {f"firstfix_builder.sources.{kind}_reader" for kind in READERS}
    module = "firstfix_builder.build_stages"
    path = file_of(module)
    assert path is not None
    tree = ast.parse(path.read_text())
    modules = {name: source for source, name in imported(tree, module.rpartition(".")[0])}
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            words = {one.value for one in ast.walk(node) if isinstance(one, ast.Constant)}
            used = {one.id for one in ast.walk(node) if isinstance(one, ast.Name)} & modules.keys()
            for stage in words & set(STAGES) if "stage(" in ast.unparse(node) else ():
                yield str(stage), {modules[name] for name in used}


def test_each_stage_knows_the_libraries_that_its_code_imports():
    missing, seen = {}, set()
    for stage, modules in stages_with_modules():
        seen.add(stage)
        called = {name for name in libraries_behind(modules) if stage not in NOT_CALLED.get(name, ())}
        without = called - libraries_of(stage).keys()
        if without:
            missing[stage] = without
    assert not missing
    assert seen == set(STAGES)
    assert set(READERS) == {name for name in readers() if " of " not in name}


def test_no_library_is_left_out_of_consideration():
    """A new one belongs to the stages that it decides, or to those that decide nothing."""
    used = {module.partition(".")[0] for module in closure("firstfix_builder.pipeline")}
    known = LIBRARIES | OTHERS
    third = {name for name in used if name not in ROOTS and version_of(name) != "none"}
    assert third <= known, third - known


def closure(module: str) -> set[str]:
    seen: set[str] = set()
    todo = [module]
    while todo:
        one = todo.pop()
        if one not in seen:
            seen.add(one)
            todo += imports_of(one) if file_of(one) else ()
    return seen


def keys_with(monkeypatch: pytest.MonkeyPatch, cache: StageCache, library: str) -> dict[str, str]:
    def changed(name: str) -> str:
        return "changed" if name == library else version_of(name)

    with monkeypatch.context() as patch:
        patch.setattr(library_versions, "version_of", changed)
        return keys_of(cache)


def keys_of(cache: StageCache) -> dict[str, str]:
    return {name: cache.key_of(name, {}, {}) for name in (*STAGES, "cluster/ClusterChunk")}


@pytest.mark.parametrize(
    ("library", "kept"),
    [
        ("numpy", set()),
        ("scipy", set()),
        ("open3d", {"fit_engine", "cluster", "cluster/ClusterChunk", "draw_cloud"}),
        ("faiss", set(STAGES) - {"read_map", "build_index", "self_test"} | {"cluster/ClusterChunk"}),
        ("laspy", set(STAGES) - {"read_map", "self_test"} | {"cluster/ClusterChunk"}),
        ("pye57", set(STAGES) - {"read_map", "self_test"} | {"cluster/ClusterChunk"}),
        ("trimesh", set(STAGES) - {"read_map", "self_test"} | {"cluster/ClusterChunk"}),
        ("rosbags", set(STAGES) | {"cluster/ClusterChunk"}),
    ],
)
def test_a_library_changes_the_keys_of_its_stages_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, library: str, kept: set[str]
):
    cache = StageCache(tmp_path)
    before, after = keys_of(cache), keys_with(monkeypatch, cache, library)
    assert {name for name in before if before[name] == after[name]} == kept


def test_a_stage_is_made_anew_by_another_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    made: list[str] = []

    def produce(out: Path) -> None:
        made.append("one")
        (out / "a").write_bytes(b"a")

    StageCache(tmp_path).run("reconstruct_mesh", {}, {}, produce)
    StageCache(tmp_path).run("reconstruct_mesh", {}, {}, produce)
    assert len(made) == 1
    newer = "newer"
    monkeypatch.setattr(library_versions, "version_of", lambda name: newer)
    StageCache(tmp_path).run("reconstruct_mesh", {}, {}, produce)
    assert len(made) == 2


def test_versions_are_those_of_the_distributions():
    assert version_of("numpy") == version("numpy")
    assert version_of("faiss") == version("faiss-cpu")
    assert version_of("lzf") == version("python-neo-lzf")
    assert version_of("no such library") == "none"
