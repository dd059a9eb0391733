"""A sample of the drill: ``firstfix-lab rot`` damages every object of a store with a built map."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix.store.store import Store
from firstfix_lab.drills.rot import Rot
from firstfix_lab.drills.rot_store import fill

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("seed", [1, 2])
def test_damage_is_named_or_harmless_and_all_else_goes_on(tmp_path: Path, seed: int):
    store = Store.open(str(tmp_path / "store"))
    fill(store, tmp_path / "made")
    drill = Rot(store, tmp_path, bits=2, seed=seed)
    keys = drill.one_of_each_kind()
    assert len(keys) >= 20
    table = drill.run(keys)
    assert table.failures == 0, "\n".join(table.examples)
    assert table.total("not restored") == 0
    assert table.total("named") > len(keys)
