"""Stacks of all threads as text, without variables, which could contain secrets."""

from __future__ import annotations

import itertools
import sys
import threading
import traceback
from types import FrameType

MOST_FRAMES = 25  # of one thread, the innermost
MAX_CHARS = 24_000


def stacks_of_all_threads() -> str:
    """Returns the stacks, innermost frame last. Threads that stand at the same place share one stack."""
    names = {thread.ident: thread.name for thread in threading.enumerate()}
    main = threading.main_thread().ident
    found: dict[str, list[str]] = {}
    frames = sys._current_frames()
    for ident in sorted(frames, key=lambda one: (one != main, names.get(one, ""))):
        found.setdefault(_text(frames[ident]), []).append(names.get(ident, f"thread {ident}"))
    whole = "\n".join(f"{', '.join(threads)}:\n{text}" for text, threads in found.items())
    return whole if len(whole) <= MAX_CHARS else f"{whole[:MAX_CHARS]}\n..."


def _text(frame: FrameType) -> str:
    """Reads no source file: its disk may be what hangs."""
    inner = itertools.islice(traceback.walk_stack(frame), MOST_FRAMES)
    lines = [f"  {one.f_code.co_filename}:{line} {one.f_code.co_name}" for one, line in inner]
    return "\n".join(reversed(lines))
