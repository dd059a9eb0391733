"""Publication during a garbage collection: in every order, the published version is whole."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.store.store import Store
from tests.interleavings import Step, run_every_order, run_interleaved

pytestmark = pytest.mark.slow

FILES = {"a.npy": b"content", "z.npy": b"more of it"}


def retired(store: Store, made: tuple[Path, Manifest]) -> None:
    """A version that was published and taken out of service."""
    catalog = Catalog(store)
    catalog.retire("hall", catalog.publish("hall", *made), force=True)


def never_ended(store: Store, made: tuple[Path, Manifest]) -> None:
    """Files of a publication that was killed before its log entry."""
    folder, manifest = made
    at = f"maps/hall/versions/{manifest.digest}"
    for name in FILES:
        store.put_file(f"{at}/{name}", folder / name)
    store.put_new(f"{at}/manifest.json", manifest.to_json())


def one_file(store: Store, made: tuple[Path, Manifest]) -> None:
    """First file of a publication that was killed then."""
    store.put_file(f"maps/hall/versions/{made[1].digest}/a.npy", made[0] / "a.npy")


LEFT = [retired, never_ended, one_file]


def collect(store: Store) -> None:
    Catalog(store).collect_garbage("hall", older_than_s=-5)  # whatever its age


def check_whole(store: Store, made: tuple[Path, Manifest], cache: Path) -> None:
    """Checks that the version is served, also after another collection and another publish."""
    version = made[1].digest
    for _ in range(2):
        catalog = Catalog(store)
        assert catalog.active_version("hall") == version
        for name, content in FILES.items():
            assert catalog.read_file("hall", version, name, max_bytes=100) == content
        collect(store)
    assert Catalog(store).publish("hall", *made) == version
    Catalog(store).fetch_version("hall", version, cache)


@pytest.mark.parametrize("left", LEFT)
def test_a_version_published_during_a_collection_is_whole(left, made, tmp_path, monkeypatch):
    def run(switches: tuple[int, ...]) -> list[Step]:
        store = Store.open("memory://")
        left(store, made)
        works = [lambda: Catalog(store).publish("hall", *made), lambda: collect(store)]
        steps = run_interleaved(works, switches, monkeypatch=monkeypatch)
        check_whole(store, made, tmp_path / "cache")
        return steps

    run_every_order(run)


@pytest.mark.parametrize("left", LEFT)
@pytest.mark.parametrize("killed", ["publish", "collect"])
def test_a_kill_at_any_point_is_mended_by_a_repeat(left, killed, made, tmp_path, monkeypatch):
    def run(kill_at: int, switches: tuple[int, ...]) -> int:
        store = Store.open("memory://")
        left(store, made)
        works = [lambda: Catalog(store).publish("hall", *made), lambda: collect(store)]
        if killed == "collect":
            works.reverse()
        steps = run_interleaved(works, switches, kill_at=kill_at, monkeypatch=monkeypatch)
        if killed == "publish":
            assert Catalog(store).publish("hall", *made) == made[1].digest
        check_whole(store, made, tmp_path / "cache")
        collect(store)
        folders = {key.split("/")[3] for key in store.list("maps/hall/versions")}
        assert len(folders) == 1, "nothing is left that nobody refers to"
        return sum(step.actor == 0 for step in steps)

    kill_at = 0
    while run(kill_at, ()) > kill_at:  # else it ended before
        for switches in ((kill_at // 2,), (kill_at // 2, kill_at)):
            run(kill_at, switches)
        kill_at += 1
