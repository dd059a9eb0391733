"""A build in its sandbox: what it may not do, and that the worker goes on whatever it tries."""

from __future__ import annotations

import io
import json
import os
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix.builds.options import BuildOptions
from firstfix.builds.shared_stages import SharedStages
from firstfix.errors import BuildCancelled, BuildFailed, FirstfixError, TooLarge
from firstfix.store.store import Store
from firstfix_builder.job.build_job import BuildJob, BuildResult
from firstfix_builder.sandbox import seccomp
from firstfix_builder.sandbox.hand_over import take_files
from firstfix_builder.sandbox.kernel import SIGNALS_VERSION, landlock_version
from firstfix_builder.sandbox.sandboxed_build import SandboxedBuild
from firstfix_builder.sources import archive_reader, write_level_map
from firstfix_builder.worker import build_here
from tests.small_world import CONFIG

PROGRAM = (str(Path(__file__).with_name("sandbox_programs.py")),)
SECRET = "a secret of the store"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        landlock_version() < SIGNALS_VERSION,
        reason="needs Landlock of version 6: run on Linux 6.12 or later",
    ),
]


@dataclass
class Place:
    """A worker's folder, with a source in it, and things beside it."""

    work: Path
    store: Path
    required: bool = True

    def build(
        self,
        do: str,
        *,
        cancelled: bool = False,
        shared: bool = False,
        memory_bytes: int | None = None,
        **told: Any,
    ) -> BuildResult:
        source = self.work / "sources" / "hall.ply"
        source.parent.mkdir(parents=True, exist_ok=True)
        source.write_bytes(b"a cloud")
        options = BuildOptions(
            build_id="b1",
            work=self.work,
            store=str(self.store),
            sandbox="required" if self.required else "auto",
            max_memory_bytes=memory_bytes,
            share_stages=shared,
        )
        job = BuildJob(
            source,
            None,
            config_telling(do=do, **told),
            self.work,
            lambda stage, fraction: None,
            lambda: cancelled,
        )
        return SandboxedBuild(options, program=PROGRAM).build_version(job)


def config_telling(**told: Any) -> dict[str, Any]:
    return {"sensor": {"preset": "vlp-16", "name": json.dumps(told)}}


@pytest.fixture
def place(tmp_path: Path) -> Place:
    (tmp_path / "store").mkdir()
    (tmp_path / "store" / "secret").write_text(SECRET)
    return Place(tmp_path / "work", tmp_path / "store")


@pytest.fixture
def attempts(place: Place, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Results of everything that a build could try."""
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", SECRET)
    monkeypatch.setenv("FIRSTFIX_STORE", str(place.store))
    signalled = []
    before = signal.signal(signal.SIGUSR1, lambda *_: signalled.append(1))
    with socket.create_server(("127.0.0.1", 0)) as tcp, socket.socket(socket.AF_UNIX) as unix:
        unix.bind(str(tmp_path / "unix"))
        unix.listen()
        built = place.build(
            "attempts",
            port=tcp.getsockname()[1],
            unix=str(tmp_path / "unix"),
            store=str(place.store),
            outside=str(tmp_path / "written"),
        )
    signal.signal(signal.SIGUSR1, before)
    assert signalled == []
    found: dict[str, str] = json.loads((built.directory / "index.bin").read_bytes())
    return found


def test_nothing_forbidden_is_done(attempts: dict[str, str], place: Place, tmp_path: Path):
    environment = json.loads(attempts.pop("environment"))
    assert {name: came for name, came in attempts.items() if came != "PermissionError"} == {
        "link from outside": "OSError",  # EXDEV: to the kernel it is another file system
        "core": "ValueError",  # a limit is not raised again
    }
    assert SECRET not in environment.values()
    assert not any(name.startswith(("AWS_", "FIRSTFIX_")) for name in environment)
    for name in ("HOME", "TMPDIR"):  # of this build alone: the next one finds nothing that it left there
        assert Path(environment[name]).is_relative_to(place.work / "build" / "tmp")
        assert not Path(environment[name]).exists()
    assert (place.store / "secret").read_text() == SECRET
    assert not (tmp_path / "written").exists()


def test_a_version_that_the_sandbox_made_is_taken_over(place: Place):
    built = place.build("succeed")
    assert (built.directory / "index.bin").read_bytes() == b"a cloud"
    assert set(built.manifest.files) == {"index.bin"}
    assert not (place.work / "build" / "tmp").exists()


@pytest.mark.parametrize(
    ("do", "told", "why"),
    [
        ("fork bomb", {}, "started more than .* processes in read_map"),
        ("thread bomb", {}, "started more than .* threads in read_map"),
        ("allocate", {"bytes": 6 << 30}, "needs more memory than it may take"),
        ("crash", {}, "ended by SIGSEGV in read_map"),
        ("leave", {}, "ended with exit code 0 in read_map"),
        ("babble", {}, "sent a message of over 262144 bytes"),
        ("lie", {"message": ["x"]}, "no known form"),
        ("lie", {"message": {"stage": "read_map", "done": None}}, "no known form"),
        ("lie", {"message": {"fetch": "../../secret"}}, "ended with exit code 0"),
        ("lie", {"message": {"share": ["a" * 64, "read_map", "../../store"]}}, "no known name"),
        ("lie", {"message": {"failed": {"code": "store_unavailable", "detail": "again"}}}, "again"),
        ("lie", {"message": {"built": True}}, "taken over|no version"),
        ("link", {"target": "/etc/passwd"}, "not a regular file"),
        ("link the folder", {"target": "/etc"}, "cannot be taken over"),
    ],
)
def test_a_build_that_goes_astray_fails_and_says_why(place: Place, do: str, told: dict[str, Any], why: str):
    with pytest.raises(BuildFailed, match=why):
        place.build(do, memory_bytes=1 << 30 if do == "allocate" else None, **told)
    assert (place.build("succeed").directory / "index.bin").read_bytes() == b"a cloud"


def test_errors_of_the_sandbox_keep_their_kind(place: Place):
    with pytest.raises(TooLarge, match="too many points"):
        place.build("fail")
    with pytest.raises(FirstfixError, match=r"^KeyError: see the worker's log$") as caught:
        place.build("stumble")
    assert caught.value.code == "internal"


def test_a_file_does_not_grow_past_the_disk(place: Place):
    with pytest.raises(BuildFailed, match="larger than it may"):
        place.build("fill a file", bytes=1 << 43)


def test_a_cancel_reaches_it(place: Place):
    with pytest.raises(BuildFailed, match="it was cancelled"):
        place.build("wait", cancelled=True)


def test_processes_that_a_build_leaves_are_ended(place: Place, tmp_path: Path):
    place.build("leave a daemon")
    left = [
        status for status in Path("/proc").glob("[0-9]*/cmdline") if str(tmp_path).encode() in _read(status)
    ]
    assert left == []


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:  # ended meanwhile
        return b""


def test_stages_go_out_and_come_in_through_the_worker(place: Place, tmp_path: Path):
    shared = SharedStages(Store.open(str(place.store)))
    key = "a" * 64
    assert place.build("share", shared=True, key=key).manifest.files
    (tmp_path / "fetched").mkdir()
    assert shared.fetch(key, tmp_path / "fetched")
    assert (tmp_path / "fetched" / "inner" / "a.bin").read_bytes() == b"a stage"
    built = place.build("fetch", shared=True, key=key)
    assert (built.directory / "index.bin").read_bytes() == b"a stage"
    with pytest.raises(BuildFailed, match="not a regular file"):
        place.build("share a link", shared=True, key="b" * 64, target="/proc/self/environ")
    assert not shared.fetch("b" * 64, tmp_path / "fetched" / "inner")


def test_a_kernel_without_seccomp_is_told_of(
    place: Place, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    program = place.work.parent / "lacking.py"
    program.write_text(
        "import os, sys\n"
        "from firstfix_builder.sandbox import confine, inside\n"
        "def refuse_system_calls(): raise OSError(38, 'not here')\n"
        "confine.refuse_system_calls = refuse_system_calls\n"
        f"sys.path.insert(0, {str(Path(__file__).parents[3])!r})\n"
        "from tests.builder.sandbox.sandbox_programs import build_version\n"
        "sys.exit(inside.main(lambda: inside.Flows(build_version, build_version)))\n"
    )
    monkeypatch.setattr(f"{__name__}.PROGRAM", (str(program),))
    with pytest.raises(BuildFailed, match="incomplete on this machine: the network is open"):
        place.build("succeed")
    place.required = False
    assert place.build("succeed").manifest.files
    assert "incomplete on this machine: the network is open (no seccomp: not here)" in caplog.text


def archive_of_sessions(path: Path) -> None:
    """Two sessions, the second one's transform known."""
    rng = np.random.default_rng(1)
    sessions = [{"source": "a.npy"}, {"source": "b.npy", "T_map_session": np.eye(4).tolist()}]
    with zipfile.ZipFile(path, "w") as made:
        for session in sessions:
            content = io.BytesIO()
            floor = rng.uniform((-8, -8, 0), (8, 8, 0.02), (6000, 3))
            wall = rng.uniform((-8, -8, 0), (8, -7.98, 2), (1000, 3))
            np.save(content, np.concatenate([floor, wall]))
            made.writestr(str(session["source"]), content.getvalue())
        made.writestr("sessions.json", json.dumps({"sessions": sessions}))


def archive_of_scans(path: Path) -> None:
    """A map of nothing but mapping scans."""
    rng, rows = np.random.default_rng(1), ["scan,tx,ty,tz,qx,qy,qz,qw"]
    with zipfile.ZipFile(path, "w") as made:
        for number in range(3):
            floor = rng.uniform((-8, -8, -1), (8, 8, -0.98), (6000, 3))
            wall = rng.uniform((-8, -8, -1), (8, -7.98, 1), (1000, 3))
            content = io.BytesIO()
            np.save(content, np.concatenate([floor, wall]).astype(np.float32))
            made.writestr(f"mapping_scans/{number}.npy", content.getvalue())
            rows.append(f"{number}.npy,{number},0,1,0,0,0,1")
        made.writestr("mapping_scans/poses.csv", "\n".join(rows))


@pytest.mark.parametrize("name", ["yard.ply", "sessions.zip", "scans.zip"])
def test_with_a_cluster_the_source_is_read_in_the_sandbox(
    tmp_path: Path, small_map: Path, monkeypatch: pytest.MonkeyPatch, name: str
):
    """The worker, which then has the network and the store, finds the first stage's result in its cache."""
    source = tmp_path / "work" / "sources" / name
    source.parent.mkdir(parents=True)
    if name == "sessions.zip":
        archive_of_sessions(source)
    elif name == "scans.zip":
        archive_of_scans(source)
    else:
        shutil.copy(small_map, source)
    options = BuildOptions(build_id="b1", store="memory://", work=tmp_path / "work", sandbox="required")
    for read in ("read_parts", "read_map_of_scans"):
        monkeypatch.setattr(
            write_level_map, read, lambda *_, **__: pytest.fail("the worker reads the source")
        )
    monkeypatch.setattr(archive_reader, "unpack", lambda *_: pytest.fail("the worker reads the source"))
    seen: list[str] = []

    def stop_after_the_first_stage() -> bool:
        return len(seen) > 0 and seen[-1] != "read_map"

    with pytest.raises(BuildCancelled):
        build_here(
            options,
            SandboxedBuild(options),
            BuildJob(
                source,
                None,
                CONFIG,
                tmp_path / "work",
                lambda stage, fraction: seen.append(stage),
                stop_after_the_first_stage,
            ),
        )
    assert set(seen) == {"read_map", "reconstruct_mesh"}


def test_before_it_is_confined_it_has_run_the_standard_library_alone():
    """A library of a build could start threads, which would not be confined, or read files."""
    program = """
import sys
from firstfix_builder.sandbox import confine

def stop(**given):
    found = {name.partition(".")[0] for name in sys.modules}
    own = sorted(name for name in sys.modules if name.startswith("firstfix"))
    print(sorted(found - sys.stdlib_module_names - {"__main__", "firstfix_builder"}), own)
    sys.exit(0)

confine.confine = stop
from firstfix_builder.sandbox import inside
inside.main()
"""
    arguments = [
        "--work",
        ".",
        "--sources",
        ".",
        "--messages-to",
        "1",
        "--memory-bytes",
        "1",
        "--file-bytes",
        "1",
    ]
    ended = subprocess.run(
        [sys.executable, "-S", "-P", "-c", program, *arguments],
        env={"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert ended.stdout == (
        "[] ['firstfix_builder', 'firstfix_builder.sandbox', 'firstfix_builder.sandbox.confine', "
        "'firstfix_builder.sandbox.inside', 'firstfix_builder.sandbox.kernel', "
        "'firstfix_builder.sandbox.seccomp']\n"
    )


def test_files_outside_the_folder_are_not_taken_over(tmp_path: Path):
    root, elsewhere = tmp_path / "root", tmp_path / "elsewhere"
    (root / "inner").mkdir(parents=True)
    (elsewhere / "deep").mkdir(parents=True)
    (elsewhere / "secret").write_text(SECRET)
    (root / "way").symlink_to(elsewhere)
    os.mkfifo(root / "inner" / "pipe")
    for number, folder in enumerate(("way", "way/deep", "../elsewhere", str(elsewhere), "inner", "", "none")):
        with pytest.raises(BuildFailed):
            take_files(root, folder, tmp_path / f"taken-{number}")


@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
def test_the_filter_holds_to_the_kernels_headers(machine: str):
    """Each system call by its number, as the headers have it; and every jump lands within the program."""
    header = {
        "x86_64": Path("/usr/include/x86_64-linux-gnu/asm/unistd_64.h"),
        "aarch64": Path("/usr/include/asm-generic/unistd.h"),
    }[machine]
    if not header.exists():
        pytest.skip(f"needs {header}: apt-get install linux-libc-dev")
    known = dict(re.findall(r"#define __NR(?:3264)?_(\w+)\s+(\d+)", header.read_text()))
    column = ("x86_64", "aarch64").index(machine)
    for name, numbers in seccomp._REFUSED.items():
        assert str(numbers[column]) == known.get(name, "None"), name
    code = seccomp.filter_program(machine)
    steps = [struct.unpack_from("=HBBI", code, at) for at in range(0, len(code), 8)]
    assert len(steps) < 4096
    for at, (kind, if_true, if_false, value) in enumerate(steps):
        if kind & 7 == 5:  # a jump
            assert at + 1 + max(if_true, if_false, value if kind == 5 else 0) < len(steps)
    assert steps[-1][0] == 6
