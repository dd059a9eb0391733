"""Ends worker processes together with their parent, even if the parent is killed."""

from __future__ import annotations

import multiprocessing
import os
import threading
from multiprocessing.connection import wait


def die_with_parent() -> None:
    """Ends this process when its parent ends. For ``ProcessPoolExecutor(initializer=...)``.

    Without it the processes of a pool would wait for ever after a kill -9 of the parent: each holds both ends
    of the pipe through which it gets its work.
    """
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True, name="die-with-parent").start()
