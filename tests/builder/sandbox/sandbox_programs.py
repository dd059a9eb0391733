"""Forbidden things that a build could try in its sandbox: stands in for ``pipeline.build_version`` there.

    python -P sandbox_programs.py ...the options of firstfix_builder.sandbox.inside

The config says which of the functions below is run.
"""

from __future__ import annotations

import ctypes
import json
import os
import platform
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from firstfix.errors import BuildFailed, TooLarge
from firstfix_builder.sandbox import seccomp
from firstfix_builder.sandbox.inside import Flows, main


def attempts(names: dict[str, Any]) -> dict[str, str]:
    """Result of each forbidden thing: the name of the error, or what was got."""
    store, parent = Path(names["store"]), os.getppid()
    local = Path(names["outside"])
    tries: dict[str, Callable[[], Any]] = {
        "socket": lambda: socket.create_connection(("127.0.0.1", names["port"]), 5),
        "udp": lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM),
        "ipv6": lambda: socket.socket(socket.AF_INET6),
        "unix": lambda: socket.socket(socket.AF_UNIX).connect(names["unix"]),
        "io_uring": lambda: system_call("io_uring_setup", 8, bytes(120)),
        "store": lambda: (store / "secret").read_text(),
        "store's folder": lambda: list(store.iterdir()),
        "parent's environment": lambda: Path(f"/proc/{parent}/environ").read_bytes(),
        "parent's memory": lambda: Path(f"/proc/{parent}/mem").read_bytes(),
        "parent's files": lambda: Path(f"/proc/{parent}/fd/0").readlink(),
        "parent's root": lambda: list(Path("/proc", str(parent), "root", "etc").iterdir()),
        "ptrace": lambda: system_call("ptrace", 16, parent, 0, 0),
        "signal": lambda: os.kill(parent, signal.SIGUSR1),
        "passwords": lambda: Path("/etc/passwd").read_text(),
        "write outside": lambda: local.write_text("x"),
        "write to sources": lambda: (Path(names["source"]).parent / "x").write_text("x"),
        "write above": lambda: (Path.cwd().parent / "queue.lock").write_text("x"),
        "truncate outside": lambda: os.truncate(store / "secret", 0),
        "link from outside": lambda: os.link(store / "secret", "linked"),
        "run what it wrote": run_own,
        "session": lambda: subprocess.run(["true"], start_new_session=True, check=True),
        "namespace": lambda: system_call("unshare", 0x10000000),
        "core": lambda: __import__("resource").setrlimit(4, (1 << 20, 1 << 20)),
    }
    found = {}
    for name, do in tries.items():
        try:
            found[name] = f"got {do()!r}"
        except (OSError, ValueError, subprocess.SubprocessError) as error:
            found[name] = type(error).__name__
    found["environment"] = json.dumps(dict(os.environ))
    return found


def run_own() -> Any:
    program = Path("program")
    program.write_text("#!/bin/sh\n")
    program.chmod(0o700)
    return subprocess.run([program.absolute()], check=True)


def system_call(name: str, *arguments: Any) -> int:
    number = seccomp._REFUSED[name][seccomp._MACHINES[platform.machine()][0]]
    libc = ctypes.CDLL(None, use_errno=True)
    result: int = libc.syscall(number, *arguments)
    if result < 0:
        raise OSError(ctypes.get_errno(), "refused")
    return result


def fork_bomb() -> None:
    """One that grows in a line: one that doubles would take the machine from the tests beside it."""
    while os.fork():
        pass
    time.sleep(600)


def thread_bomb() -> None:
    while True:
        threading.Thread(target=time.sleep, args=(600,)).start()


def build_version(
    source: Path,
    config: Any,
    work: Path,
    *,
    progress: Callable[[str, float], None],
    cancelled: Callable[[], bool],
    shared: Any,
    **_: Any,
) -> None:
    for left in work.iterdir():
        if left.name != "tmp":
            left.unlink() if left.is_symlink() else shutil.rmtree(left, ignore_errors=True)
    told = json.loads(config.sensor_model.name)
    progress("read_map", 0.5)
    match told["do"]:
        case "attempts":
            found = attempts({**told, "source": str(source)})
            version(work, json.dumps(found).encode())
        case "succeed":
            version(work, source.read_bytes())
        case "fork bomb":
            fork_bomb()
        case "thread bomb":
            thread_bomb()
        case "allocate":
            print(len(bytearray(told["bytes"])))
        case "fill a file":
            with Path("large").open("wb") as file:
                file.seek(told["bytes"])
                file.write(b"x")
        case "leave a daemon":
            if os.fork() == 0:
                time.sleep(600)
            version(work, source.read_bytes())
        case "fail":
            raise TooLarge("too many points")
        case "stumble":
            raise KeyError(str(work))
        case "crash":
            ctypes.string_at(1)
        case "leave":
            os._exit(0)
        case "babble":
            os.write(message_handle(), b"x" * (1 << 20))
            time.sleep(600)
        case "lie":
            os.write(message_handle(), json.dumps(told["message"]).encode() + b"\n")
            os._exit(0)
        case "wait":
            while not cancelled():
                time.sleep(0.01)
            raise BuildFailed("it was cancelled")
        case "link":
            version(work, b"x")
            (work / "version" / "index.bin").unlink()
            (work / "version" / "index.bin").symlink_to(told["target"])
        case "share" | "share a link":
            stage = work / "stages" / "made"
            (stage / "inner").mkdir(parents=True)
            (stage / "inner" / "a.bin").write_bytes(b"a stage")
            if told["do"] == "share a link":
                (stage / "b.bin").symlink_to(told["target"])
            shared.put(told["key"], "read_map", stage)
            version(work, b"x")
        case "fetch":
            (work / "fetched").mkdir()
            assert not shared.fetch("c" * 64, work / "fetched")
            assert shared.fetch(told["key"], work / "fetched")
            version(work, (work / "fetched" / "inner" / "a.bin").read_bytes())
        case "link the folder":
            (work / "version").symlink_to(told["target"])
        case _:
            raise AssertionError(told)


def message_handle() -> int:
    return int(sys.argv[sys.argv.index("--messages-to") + 1])


def version(work: Path, content: bytes) -> None:
    from firstfix.catalog.manifest import Manifest

    directory = work / "version"
    directory.mkdir()
    (directory / "index.bin").write_bytes(content)
    (directory / "manifest.json").write_bytes(Manifest.for_directory(directory).to_json())


if __name__ == "__main__":
    sys.exit(main(lambda: Flows(build_version, build_version)))
