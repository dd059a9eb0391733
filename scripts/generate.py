"""Writes what is told of the code elsewhere: formats, findings, reference pages, the HTTP API, and figures.

python scripts/generate.py
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

from firstfix.decode import SCAN_FORMATS, SUFFIXES
from firstfix.findings import map_kinds, scan_kinds
from firstfix.findings.registry import kinds_of
from firstfix_service.app import create_app
from firstfix_service.settings import Settings

REPO = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(REPO / "scripts" / "site"), str(REPO)]
from cli_reference import cli_reference  # noqa: E402
from error_reference import error_reference  # noqa: E402
from http_reference import http_reference  # noqa: E402

from benchmarks.scoreboard import pages as figures  # noqa: E402

SCANS_PAGE, MAPS_PAGE = "docs/how-to/my-scan-is-not-localized.md", "docs/how-to/is-my-map-good.md"
WRONG_SCANS_PAGE, WRONG_MAPS_PAGE = "docs/reference/wrong-inputs.md", "docs/reference/wrong-maps.md"
WRONG_HEAD = "| input | answer |\n|---|---|\n"
MARK = "<!-- generated -->\n"  # of a page all that follows is made
FINDINGS_HEAD = "| symptom | code | the answer says | what helps |\n|---|---|---|---|\n"


def generated() -> dict[Path, str]:
    """Returns the files and their texts as they should be."""
    formats = "".join(
        f"| {each.encoding} | {' or '.join(f'`{name}`' for name in each.media_types)} |\n"
        for each in SCAN_FORMATS
    )
    endings = "".join(f'  "{suffix}": "{name}",\n' for suffix, name in SUFFIXES.items())
    document = create_app(Settings(store="memory://")).openapi()
    return {
        REPO / "docs/openapi.json": json.dumps(document, indent=1, sort_keys=True) + "\n",
        **_after_mark("docs/reference/cli.md", cli_reference()),
        **_after_mark("docs/reference/errors.md", error_reference()),
        **_after_mark("docs/reference/http-endpoints.md", http_reference(document)),
        **_between(SCANS_PAGE, FINDINGS_HEAD, _findings(scan_kinds), "\n"),
        **_between(MAPS_PAGE, FINDINGS_HEAD, _findings(map_kinds), "\n"),
        **_between(WRONG_SCANS_PAGE, WRONG_HEAD, _wrong_inputs("wrong_inputs.json"), "\n"),
        **_between(WRONG_MAPS_PAGE, WRONG_HEAD, _wrong_inputs("wrong_maps.json"), "\n"),
        **_between("clients/PROTOCOL.md", "| scan encoding | media type |\n|---|---|\n", formats, "\n"),
        **_figures(),
        REPO / "clients/python/firstfix_client/async_calls.py": _asynchronous_calls(),
        **_between("console/src/scan/media.ts", "const TYPES: Record<string, string> = {\n", endings, "};\n"),
    }


def _asynchronous_calls() -> str:
    """The asynchronous client's calls, made of the blocking client's. Docstrings are their summaries."""
    _, _, text = (REPO / "clients/python/firstfix_client/calls.py").read_text().partition("\n")

    def awaitable(match: re.Match[str]) -> str:
        returns_at_once = "Iterator" in match[0] or "_http" in match[0]
        return match[0] if returns_at_once else match[0].replace("def ", "async def ", 1)

    for pattern, made in (
        (r'("""[^"\n]+)\n\n.*?"""', r'\1"""'),
        (r"def \w+\([^:]*?self.*?\) -> [^\n]*:\n", awaitable),
        (r"\blist\((self\._http\.items\(.*\))\)", r"[item async for item in \1]"),
        (r"\bself\.(_http\.run|_http\.close|close)\(", r"await self.\1("),
        (r"\b__(enter|exit)__\b", r"__a\1__"),
        (r"\bCallable, Iterator\b", "AsyncIterator, Callable"),
        (r"(?<!Async)\bIterator\b", "AsyncIterator"),
        (r"\bBlockingService\b", "AsyncService"),
        (r"\bblocking_http\b", "async_http"),
        (r"\b(HttpCalls|FixCalls|MapCalls|BuildCalls|Client)\b", r"Async\1"),
    ):
        text = re.sub(pattern, made, text, flags=re.DOTALL if "\\n" in pattern else 0)
    text = f'"""Calls of the asynchronous client: scripts/generate.py makes them of calls.py."""\n{text}'
    command = [sys.executable, "-m", "ruff", "format", "--quiet", "-"]
    return subprocess.run(command, input=text, capture_output=True, text=True, check=True, cwd=REPO).stdout


def _figures() -> dict[Path, str]:
    """The pages of the scoreboard, and its pictures."""
    results = figures.load(REPO / "benchmarks/results")
    return {
        **_with_figures("README.md", figures.readme_parts(results)),
        **_with_figures("benchmarks/PAPER.md", figures.paper_parts(results)),
        **_with_figures("docs/how-to/sizing.md", figures.sizing_parts(results)),
        **_with_figures("docs/large-maps.md", figures.large_maps_parts(results)),
        **_after_mark("benchmarks/BENCHMARK.md", figures.benchmark_page(results)),
        **{REPO / "benchmarks/plots" / name: text for name, text in figures.plot_files(results).items()},
    }


def _with_figures(path: str, parts: Mapping[str, str]) -> dict[Path, str]:
    """Puts each part between its marks in a page."""
    page = (REPO / path).read_text()
    for name, text in parts.items():
        before, begun, rest = page.partition(f"<!-- figures: {name} -->\n\n")
        _, ended, after = rest.partition("\n<!-- end of figures -->\n")
        assert begun, f"{path} has no figures of {name}"
        assert ended, f"{path} does not say where the figures of {name} end"
        page = f"{before}{begun}{text}{ended}{after}"
    return {REPO / path: page}


def _findings(module: ModuleType) -> str:
    """Rows of the findings of a module, from symptom to remedy."""
    return "".join(
        f"| {kind.symptom} | `{kind.code}` | {_in_words(kind.text)} | {_in_words(kind.remedy)} |\n"
        for kind in kinds_of(module)
    )


def _wrong_inputs(table: str) -> str:
    """Rows of wrong inputs, and what they give over the command line and HTTP."""
    rows = []
    for row in json.loads((REPO / "tests/e2e" / table).read_text()):
        told = {way: _told(row[way]) for way in ("command", "http") if way in row}
        if len({row[way]["text"] for way in told}) == 1:
            cell = told["command"]
        else:
            cell = f"*Command:* {told['command']}<br>*HTTP:* {told['http']}"
        rows.append(f"| {row['input']} | {cell} |\n")
    return "".join(rows)


def _told(answer: dict[str, str]) -> str:
    words = f"{answer['text']} {answer.get('remedy', '')}".strip().replace("|", "\\|")
    code = f", `{answer['code']}`" if "code" in answer else ""
    return f"{answer['answer']}{code}: {words}"


def _in_words(text: str) -> str:
    """A finding's text with the names of its numbers in place of them."""
    return re.sub(r"{(\w+)(:[^}]*)?}", lambda match: f"*{match[1]}*", text)


def _after_mark(path: str, text: str) -> dict[Path, str]:
    """Puts a text after the mark of a page."""
    before, found, _ = (REPO / path).read_text().partition(MARK)
    assert found, f"{path} has no line {MARK!r}"
    return {REPO / path: f"{before}{MARK}\n{text}"}


def _between(path: str, begin: str, text: str, end: str) -> dict[Path, str]:
    """Puts a text between two lines of a file."""
    before, found, rest = (REPO / path).read_text().partition(begin)
    assert found, f"{path} has no line {begin!r}"
    after = rest[rest.index("\n" + end) + 1 :]
    return {REPO / path: before + begin + text + after}


if __name__ == "__main__":
    for path, text in generated().items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
