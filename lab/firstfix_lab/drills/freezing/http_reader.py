"""A caller of large answers who reads none of them."""

from __future__ import annotations

from .stranger import Stranger

_SCRIPT = """
import socket, sys
host, port, path, count = sys.argv[1:]
def connect():
    one = socket.socket()
    one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    one.bind(("127.0.0.9", 0))
    one.connect((host, int(port)))
    return one
asked = [connect() for _ in range(int(count))]
for one in asked:
    one.sendall(f"GET {path} HTTP/1.1\\r\\nHost: x\\r\\nConnection: close\\r\\n\\r\\n".encode())
print("asked", flush=True)
for one in asked:
    try:
        while one.recv(1 << 16):
            pass
    except OSError:
        pass
    one.close()
"""


def http_reader(port: int, path: str, connections: int) -> Stranger:
    return Stranger("http reader", _SCRIPT, "127.0.0.1", str(port), path, str(connections))
