"""Logs the files of the program that run, in every process that has this folder on its path.

Python imports it at its start. A line is a file of which a function has run, in whichever thread. It goes to
the file that LOG beside this program names: a build's sandbox passes no variables on.
"""

from __future__ import annotations

import os
import sys
import threading
from inspect import CO_OPTIMIZED
from pathlib import Path
from types import FrameType

_LOG = os.open(Path(__file__).with_name("LOG").read_text(), os.O_WRONLY | os.O_APPEND | os.O_CREAT)
_logged: set[str] = set()


def _log_call(frame: FrameType, event: str, _: object) -> None:
    code = frame.f_code
    if event != "call" or code.co_filename in _logged:
        return
    if not code.co_flags & CO_OPTIMIZED or code.co_name.startswith("<"):
        return  # bodies of modules and classes: they run when they are imported
    _logged.add(code.co_filename)
    packages = code.co_filename.rpartition("/firstfix")
    if packages[1]:
        os.write(_LOG, f"firstfix{packages[2]}\n".encode())


threading.setprofile(_log_call)
sys.setprofile(_log_call)
