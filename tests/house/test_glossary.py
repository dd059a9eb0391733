"""The glossary has each term once, in order, with a definition."""

import re
from pathlib import Path

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "concepts" / "glossary.md").read_text()


def test_each_term_is_defined_once():
    terms = re.findall(r"^### (.*)\n(.*)$", PAGE, re.M)
    assert len(terms) > 40
    names = [name.lower() for name, _ in terms]
    assert len(names) == len(set(names))
    assert all(definition.strip() for _, definition in terms)


def test_terms_are_in_order():
    for section in PAGE.split("\n## ")[1:]:
        terms = [name.lower() for name in re.findall(r"^### (.*)$", section, re.M)]
        assert terms == sorted(terms), section.splitlines()[0]
