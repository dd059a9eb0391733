"""Logs calls of some functions, and all files that run, in every process that has this folder on its path.

Python imports it at its start. Each call appends a line to the file CALL_LOG: what was called, and the
process id. Files are those of the service and the core, of which a function runs in the main thread.
"""

from __future__ import annotations

import os
import sys
import threading
from types import FrameType

LOGGED = {
    ("answer/options.py", "from_strings"): "parse options",
    ("firstfix/decode.py", "decoder_of"): "look up media type",
    ("wire/content_encoding.py", "decompressor_of"): "look up content encoding",
    ("firstfix/ids.py", "check_map_id"): "check map id",
    ("catalog/version_prefix.py", "check_prefix"): "check version",
    ("auth/principal.py", "check"): "check scope",
    ("auth/principal.py", "check_map"): "check map of caller",
    ("auth/authenticate.py", "permit"): "take from rate limit",
    ("localize/query_gate.py", "check_room"): "check room",
    ("query_workers/query.py", "read"): "read query",
    ("wire/scan.py", "decode_scan"): "decode body",
}
_MAIN = threading.main_thread()
_NAMES = {name for _, name in LOGGED}
_LOG = os.open(os.environ["CALL_LOG"], os.O_WRONLY | os.O_APPEND | os.O_CREAT)


def _log_call(frame: FrameType, event: str, _: object) -> None:
    code = frame.f_code
    if event == "call" and code.co_name in _NAMES:
        file = "/".join(code.co_filename.rsplit("/", 2)[1:])
        if (file, code.co_name) in LOGGED:
            _write(LOGGED[file, code.co_name])
    if event == "call" and code.co_name != "<module>" and threading.current_thread() is _MAIN:
        packages = code.co_filename.rpartition("/firstfix")
        if packages[1]:
            _write(f"file firstfix{packages[2]}")


def _write(what: str) -> None:
    os.write(_LOG, f"{what},{os.getpid()}\n".encode())


threading.setprofile(_log_call)
sys.setprofile(_log_call)
