"""The glossary defines each term once, and the names of code in it exist."""

import re
import subprocess
from pathlib import Path

REPO = Path(__file__).resolve().parents[2]
PAGE = (REPO / "docs" / "concepts" / "glossary.md").read_text()


def test_each_term_is_defined_once():
    terms = re.findall(r"^### (.*)\n(.*)$", PAGE, re.M)
    assert len(terms) > 40
    names = [name.lower() for name, _ in terms]
    assert len(names) == len(set(names))
    assert all(definition.strip() for _, definition in terms)


def test_each_name_of_code_exists():
    named = re.findall(r"`([A-Za-z]\w*)`", PAGE)
    listed = subprocess.run(
        ["git", "ls-files", "core", "service", "builder", "clients", "cli"],
        cwd=REPO,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    sources = "\n".join((REPO / name).read_text() for name in listed if name.endswith(".py"))
    assert len(named) > 8
    defined = re.compile(r"(?m)^\s*(?:class|def) (\w+)|^\s*(\w+)(?:: [^=\n]+)?(?: =|$)|\"(\w+)\"")
    known = {word for match in defined.finditer(sources) for word in match.groups() if word}
    settings = {f"FIRSTFIX_{word.upper()}" for word in known}
    assert not set(named) - known - settings
