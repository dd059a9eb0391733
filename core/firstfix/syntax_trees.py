"""One syntax tree at a time, on versions of Python in which threads that make two disturb each other.

CPython 3.11 and 3.12 counted the depth of a tree in one number for all threads, until early in 2024 (its
issue 106905). NumPy reads the header of every .npy file as a syntax tree. So two threads that open files at
once, as those of a build do, could fail with a SystemError. Debian 12 has such a version.
"""

from __future__ import annotations

import ast
import os
import sys
import threading
from typing import Any


def make_one_at_a_time() -> None:
    """Let only one thread at a time into ``ast.parse``, on the versions of Python that may need it."""
    if sys.version_info >= (3, 13):
        return
    parse, lock = ast.parse, threading.RLock()

    def parse_alone(*arguments: Any, **options: Any) -> ast.AST:
        with lock:
            return parse(*arguments, **options)

    # A child of a fork would wait for ever for a thread that it does not have.
    os.register_at_fork(before=lock.acquire, after_in_parent=lock.release, after_in_child=lock.release)
    ast.parse = parse_alone  # type: ignore[assignment]  # literal_eval looks it up there
