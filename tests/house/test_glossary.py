"""The glossary has each term once, in order, with a definition, and former words for these terms are gone."""

import re
import subprocess
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parents[2]
PAGE = (REPO / "docs" / "concepts" / "glossary.md").read_text()
# Former words, and the word that the glossary has in their place.
FORMER = {
    "twin": "perceptual alias",
    "proposal": "candidate",
    "judg(e)?ment": "hypothesis",
    "closeness": "alignment score",
    "walkable": "traversable",
    "disturb(ed|ing|ance)?": "perturb",
}
FORMER_WORD = re.compile(rf"(?<![a-z])({'|'.join(FORMER)})s?(?![a-z])", re.I)
SPOKEN = ("core", "service", "builder", "clients", "cli", "native", "docs", "examples", "README.md")


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


def test_terms_are_in_order():
    for section in PAGE.split("\n## ")[1:]:
        terms = [name.lower() for name in re.findall(r"^### (.*)$", section, re.M)]
        assert terms == sorted(terms), section.splitlines()[0]


def test_former_words_are_gone():
    listed = subprocess.run(
        ["git", "ls-files", *SPOKEN], cwd=REPO, capture_output=True, text=True, check=True
    ).stdout.split()
    texts = {name: (REPO / name).read_bytes().decode("utf-8", errors="ignore") for name in listed}
    found = [f"{name}: {match[0]}" for name, text in texts.items() for match in FORMER_WORD.finditer(text)]
    assert not found
    assert all(word in PAGE.lower() for word in FORMER.values())


@pytest.mark.parametrize("text", ["two twins", "is_walkable", "min_closeness", "Proposals", "disturbed"])
def test_a_former_word_is_recognised(text: str):
    assert FORMER_WORD.search(text)


@pytest.mark.parametrize("text", ["between", "traversable", "undisturbedly", "perturbed"])
def test_other_words_pass(text: str):
    assert not FORMER_WORD.search(text)
