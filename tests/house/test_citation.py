"""CITATION.cff has what its format asks for, and names the paper that the method starts from."""

from pathlib import Path

import yaml

REPO = Path(__file__).resolve().parents[2]


def test_the_citation_is_complete():
    citation = yaml.safe_load((REPO / "CITATION.cff").read_text())
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert citation["cff-version"] == "1.2.0"
    assert citation["type"] == "software"
    assert citation["license"] == "Apache-2.0"
    assert [set(author) for author in citation["authors"]] == [{"name"}]
    (paper,) = citation["references"]
    assert {"type", "title", "authors"} <= set(paper)
    assert paper["title"] in (REPO / "docs" / "method.md").read_text().replace("\n", " ")
    assert all(set(author) == {"given-names", "family-names"} for author in paper["authors"])
