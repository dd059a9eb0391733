"""Writes what is told of the code elsewhere: formats, findings, the HTTP API, and figures.

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

from firstfix.findings import map_kinds, scan_kinds
from firstfix.findings.registry import kinds_of
from firstfix.scan_formats import SCAN_FORMATS, SUFFIXES
from firstfix_service.app import create_app
from firstfix_service.settings import Settings

REPO = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(REPO))
from firstfix_lab.scoreboard import pages as figures  # noqa: E402

SCANS_PAGE, MAPS_PAGE = "docs/how-to/my-scan-is-not-localized.md", "docs/how-to/my-map.md"
MARK = "<!-- generated -->\n"  # of a page all that follows is made
FINDINGS_HEAD = "| symptom | code | what helps |\n|---|---|---|\n"  # the answer says the rest itself


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
        **_between(SCANS_PAGE, FINDINGS_HEAD, _findings(scan_kinds), "\n"),
        **_between(MAPS_PAGE, FINDINGS_HEAD, _findings(map_kinds), "\n"),
        **_between("clients/PROTOCOL.md", "| scan encoding | media type |\n|---|---|\n", formats, "\n"),
        **_figures(),
        REPO / "clients/cpp/src/version/finding_kinds.hpp": _finding_kinds(),
        REPO / "clients/python/firstfix_client/async_calls.py": _asynchronous_calls(),
        **_between(
            "plugins/console/page/src/scan/media.ts",
            "const TYPES: Record<string, string> = {\n",
            endings,
            "};\n",
        ),
    }


def _finding_kinds() -> str:
    """The kinds of findings of scans, for robots that localize in C++."""
    rows = "".join(
        f"    {{{json.dumps(kind.code)}, {json.dumps(kind.severity.value)},\n"
        f"     {json.dumps(kind.text)},\n"
        f"     {json.dumps(kind.remedy)}}},\n"
        for kind in kinds_of(scan_kinds)
    )
    return (
        "// Kinds of findings of scans: scripts/generate.py makes them of firstfix.findings.scan_kinds.\n"
        "#pragma once\n\nnamespace firstfix::version {\n\n"
        "// text, remedy: with the names of numbers and words in braces, as for Python's str.format.\n"
        "struct FindingKind {\n  const char *code, *severity, *text, *remedy;\n};\n\n"
        f"constexpr const char* kFindingsPage = {json.dumps(scan_kinds.PAGE)};\n"
        f"constexpr FindingKind kFindingKinds[] = {{\n{rows}}};\n\n}}  // namespace firstfix::version\n"
    )


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
    results = figures.load(REPO / "lab/results")
    return {
        **_with_figures("README.md", figures.readme_parts(results)),
        **_with_figures("lab/PAPER.md", figures.paper_parts(results)),
        **_with_figures("docs/how-to/deploy.md", figures.sizing_parts(results)),
        **_with_figures("lab/docs/large-maps.md", figures.large_maps_parts(results)),
        **_after_mark("lab/BENCHMARK.md", figures.benchmark_page(results)),
        **{REPO / "lab/plots" / name: text for name, text in figures.plot_files(results).items()},
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
        f"| {kind.symptom} | `{kind.code}` | {_in_words(kind.remedy)} |\n" for kind in kinds_of(module)
    )


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
