"""Holds searches of maps until their query is cancelled, in each process that has this folder on its path.

Python imports it at its start. A search then begins as it would without: only its cancellation can end it so
early. Each that is held appends a line to the file HELD_SEARCHES. Only queries that ask for HELD candidates
are held.
"""

from __future__ import annotations

import os
import sys
import time
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any

HELD = 77
NAME = "firstfix.engine.map_search"


class _Holding(MetaPathFinder, Loader):
    """Imports the module as it is, and lets its searches wait."""

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        if name != NAME or (spec := PathFinder.find_spec(name, path)) is None:
            return None
        self._loader, spec.loader = spec.loader, self
        return spec

    def exec_module(self, module: ModuleType) -> None:
        assert self._loader is not None
        self._loader.exec_module(module)
        answer = module.MapSearch.answer

        def held(search: Any, others: Any, options: Any, **more: Any) -> Any:
            if options.max_candidates == HELD:
                with Path(os.environ["HELD_SEARCHES"]).open("a") as log:
                    log.write(f"{1 + len(others)}\n")
                while not search._watch.deadline.cancellation.is_requested:
                    time.sleep(0.001)
            return answer(search, others, options, **more)

        module.MapSearch.answer = held


sys.meta_path.insert(0, _Holding())
