#!/usr/bin/env bash
# obstore, S3: deleting one object sends POST ?delete (DeleteObjects), not DELETE; a 501 to it is asked again many times.
#
# Version: obstore 0.12.1 (Python 3.11), against a server of this script that answers 501 (Not Implemented).
# Behaviour: delete(store, "one") sends POST /bucket?delete with a list of one key, as delete(store, ["one"]) does. A store
# that knows DELETE of an object and no multi-object delete answers 501, a permission for DeleteObject in a proxy that goes
# by method and path is not enough, and the answer 501, which no repetition mends, is retried as a momentary failure.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check obstore==0.12.1
"$folder/venv/bin/python" - <<'PYTHON'
import threading
from datetime import timedelta
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import obstore
from obstore.store import S3Store

asked = []


class NotImplementedServer(BaseHTTPRequestHandler):
    def answer(self):
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        asked.append((self.command, self.path, body.count(b"<Object>")))
        self.send_response(501)
        self.send_header("Content-Length", "0")
        self.end_headers()

    do_POST = do_DELETE = answer

    def log_message(self, *_):
        pass


server = ThreadingHTTPServer(("127.0.0.1", 0), NotImplementedServer)
threading.Thread(target=server.serve_forever, daemon=True).start()
store = S3Store(
    "bucket", region="us-east-1", endpoint=f"http://127.0.0.1:{server.server_port}", access_key_id="a",
    secret_access_key="b", client_options={"allow_http": True},
    retry_config={
        "max_retries": 3, "retry_timeout": timedelta(seconds=30),
        "backoff": {"init_backoff": timedelta(milliseconds=1), "max_backoff": timedelta(milliseconds=2), "base": 2},
    },
)
try:
    obstore.delete(store, "one")
except Exception as error:
    print(f"{type(error).__name__} after {len(asked)} requests")
print(*sorted(set(asked)), sep="\n")
assert {method for method, _, _ in asked} == {"POST"}, "a DELETE was sent: the behaviour has changed"
assert {keys for _, _, keys in asked} == {1}
assert len(asked) == 4, "501 is not retried as often: the behaviour has changed"
PYTHON
# Output seen:
#   GenericError after 4 requests
#   ('POST', '/bucket?delete', 1)
echo "as described"
