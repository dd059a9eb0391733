#!/usr/bin/env bash
# ouster-sdk: to import it replaces sqlite3.connect of the whole process, without the check of threads.
#
# Version: ouster-sdk 1.0.1 (Python 3.11), installed without its dependencies but NumPy and the rosbags that it pins.
# Behaviour: `import ouster.sdk.core` sets sqlite3.connect to a function that passes check_same_thread=False in every call, also
# where the caller asks for True. sqlite3's error for a connection that is used in another thread is gone from then on, for
# code that has nothing to do with a LiDAR.
# Who relies on that error to find a mistake, or on check_same_thread=True, loses it by an import.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check --no-deps ouster-sdk==1.0.1
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check numpy==2.2.6 rosbags==0.9.23
"$folder/venv/bin/python" - <<'PYTHON'
import sqlite3
import threading


def used_in_another_thread():
    opened = sqlite3.connect(":memory:", check_same_thread=True)
    said = []

    def use():
        try:
            opened.execute("SELECT 1")
            said.append("no error")
        except sqlite3.ProgrammingError:
            said.append("ProgrammingError")

    thread = threading.Thread(target=use)
    thread.start()
    thread.join()
    return said[0]


before, function = used_in_another_thread(), sqlite3.connect
import ouster.sdk.core

print(f"before the import: {before}")
print(f"after the import:  {used_in_another_thread()}, sqlite3.connect is {sqlite3.connect.__module__}.{sqlite3.connect.__name__}")
assert before == "ProgrammingError"
assert sqlite3.connect is not function, "the behaviour has changed"
assert used_in_another_thread() == "no error", "the behaviour has changed"
PYTHON
# Output seen:
#   before the import: ProgrammingError
#   after the import:  no error, sqlite3.connect is ouster.sdk.bag.bag_packet_source._new_connect
echo "as described"
