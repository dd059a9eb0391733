"""A zenoh client with replies waiting: more than the buffers between two processes hold."""

from __future__ import annotations

from .stranger import Stranger

QUERIES, LISTS = 16, 3000  # half of the service's queue: nobody is refused for them
_SCRIPT = f"""
import json, sys, time, zenoh
endpoint, body = sys.argv[1], open(sys.argv[2], "rb").read()
session = zenoh.open(zenoh.Config.from_json5(json.dumps({{
    "mode": "client", "connect": {{"endpoints": [endpoint + "#so_rcvbuf=4096"]}},
    "scouting": {{"multicast": {{"enabled": False}}}}}})))
media_type = "application/vnd.firstfix.xyz"
asked = [session.get("firstfix/yard/localize", payload=body, encoding=media_type, timeout=60)
         for _ in range({QUERIES})]
asked += [session.get("firstfix/*/version", timeout=60) for _ in range({LISTS})]
print("asked", flush=True)
for one in asked:
    list(one)
"""


def zenoh_peer(endpoint: str, body_file: str) -> Stranger:
    return Stranger("zenoh peer", _SCRIPT, endpoint, body_file)
