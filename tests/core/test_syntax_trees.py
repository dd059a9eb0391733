"""Threads that read headers of NumPy's files at once."""

from __future__ import annotations

import subprocess
import sys

import pytest

# Collections of garbage let another thread in while a tree is made.
PROGRAM = """
import ast, gc, os, sys, threading, time
import firstfix.catalog

HEADER = "[" + "{'descr': '<f8'}, " * 40 + "]"
failed = []

def read():
    for _ in range(400):
        try:
            ast.literal_eval(HEADER)
        except SystemError as error:
            failed.append(error)

gc.callbacks.append(lambda phase, info: time.sleep(1e-4))
gc.set_threshold(20)
threads = [threading.Thread(target=read) for _ in range(4)]
for thread in threads:
    thread.start()
for _ in range(5):
    child = os.fork()
    if not child:
        ast.literal_eval(HEADER)
        os._exit(0)
    if os.waitpid(child, 0)[1]:
        failed.append(child)
for thread in threads:
    thread.join()
gc.set_threshold(700)
sys.exit(len(failed) > 0)
"""


@pytest.mark.timeout(240)
def test_threads_that_read_at_once_do_not_fail_and_a_fork_does_not_hang():
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
