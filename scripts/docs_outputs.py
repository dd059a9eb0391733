"""Makes the printed outputs of the tutorials by running their commands.

    python scripts/docs_outputs.py           # run all, and write what they print into the pages
    python scripts/docs_outputs.py --small   # only what takes seconds

A fenced block after the mark ``<!-- run -->`` is run, and the ``text`` block that follows it at once, if
there is one, becomes what it printed. ``<!-- run, small -->`` takes seconds and needs no build; ``<!-- serve
-->`` runs until all is done. The pages of one tutorial share a folder, which is thrown away. All worlds are
seeded, so a run on another day prints the same. Lines with times are left out.
"""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

REPO = Path(__file__).resolve().parents[1]
TUTORIALS = (("docs/how-to/my-map.md", "docs/how-to/ambiguous.md"),)
LIMIT_S = 1800
START_S = 120
_BLOCK = re.compile(
    r"(?ms)^(?P<indent> *)<!-- (?P<mark>run|run, small|serve) -->\n(?P=indent)```(?P<language>sh|python)\n"
    r"(?P<code>.*?)^(?P=indent)```\n"
    r"(?:\n(?P=indent)```text\n(?P<output>.*?)^(?P=indent)```\n)?"
)
_WITH_TIMES = re.compile(r"(?m)^ *(?:ms|published) .*\n")  # a version's also names the machine


def _free_port() -> int:
    """A port for the service: that of the pages may be taken."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return int(listener.getsockname()[1])


PORT = _free_port()


@dataclass(frozen=True)
class Block:
    """A block that is run.

    Attributes:
        mark: run; run, small; serve.
        output: what the page says that it prints; None: the page does not show it.
        span: of the output's text in the page.
    """

    mark: str
    language: str
    code: str
    indent: str
    output: str | None
    span: tuple[int, int]


def blocks_of(page: str) -> Iterator[Block]:
    """Yield the marked blocks of a page, in order."""
    for match in _BLOCK.finditer(page):
        indent, output = match["indent"], match["output"]
        yield Block(
            match["mark"],
            match["language"],
            _moved(match["code"], indent, ""),
            indent,
            None if output is None else _moved(output, indent, ""),
            match.span("output"),
        )


def printed_by(block: Block, folder: Path) -> str:
    """Run a block in a folder. Returns what it prints, without the times.

    Raises:
        RuntimeError: it failed.
    """
    command = ["bash", "-ec", block.code] if block.language == "sh" else [sys.executable, "-c", block.code]
    done = subprocess.run(
        command, cwd=folder, env=_environment(folder), capture_output=True, text=True, timeout=LIMIT_S
    )
    # an answer that is not localized has an exit code of its own
    if done.returncode not in (0, 3):
        raise RuntimeError(f"{block.code}{done.stdout}{done.stderr}")
    return _WITH_TIMES.sub("", done.stdout)


def with_outputs(page: str, folder: Path, services: ExitStack, *, small: bool = False) -> str:
    """The page with the outputs of its blocks, which run in the folder.

    Args:
        services: ends what the page serves.
        small: only the blocks that take seconds.
    """
    made, at = [], 0
    for block in blocks_of(page):
        if small and block.mark != "run, small":
            continue
        if block.mark == "serve":
            _serve(block, folder, services)
            continue
        printed = printed_by(block, folder)
        if block.output is not None:
            made += page[at : block.span[0]], _moved(printed, "", block.indent)
            at = block.span[1]
    return "".join([*made, page[at:]])


def _serve(block: Block, folder: Path, services: ExitStack) -> None:
    process = subprocess.Popen(
        ["bash", "-ec", f"exec {block.code.strip()}"],
        cwd=folder,
        env=_environment(folder),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    services.callback(process.wait)
    services.callback(process.terminate)
    end = time.monotonic() + START_S
    while True:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{PORT}/readyz", timeout=10):
                return
        except OSError as error:
            if process.poll() is not None or time.monotonic() > end:
                raise RuntimeError(f"{block.code} does not serve") from error
            time.sleep(0.2)


def _environment(folder: Path) -> dict[str, str]:
    """Variables of the commands: their own caches, and lines as wide as a page has them."""
    own = {
        "FIRSTFIX_PORT": str(PORT),
        "FIRSTFIX_URL": f"http://127.0.0.1:{PORT}",
        "FIRSTFIX_WORK_DIR": str(folder / ".work"),
        "FIRSTFIX_CACHE_DIR": str(folder / ".cache"),
    }
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return {**os.environ, **own, "PATH": path, "COLUMNS": "160", "NO_COLOR": "1", "HOME": str(folder)}


def _moved(text: str, was: str, becomes: str) -> str:
    """The lines with another indent."""
    lines = (line.removeprefix(was) for line in text.splitlines(keepends=True))
    return "".join(becomes + line if line.strip() else line for line in lines)


def main(arguments: list[str]) -> int:
    """Write the outputs into the pages."""
    for pages in TUTORIALS:
        with tempfile.TemporaryDirectory() as name, ExitStack() as services:
            for page in pages:
                path = REPO / page
                before = path.read_text()
                after = with_outputs(before, Path(name), services, small="--small" in arguments)
                path.write_text(after)
                print(page, "is as it was" if after == before else "has new outputs", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
