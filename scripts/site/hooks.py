"""Hooks of mkdocs: pages that are made from the repository, links into it, equations as MathML.

``mkdocs.yml`` names this file. Everything is made from files of the checkout, so the build needs no network.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cli_reference import cli_reference
from equations import with_mathml
from error_reference import error_reference
from http_reference import http_reference
from mkdocs.structure.files import File, Files
from notebook_page import notebook_files
from repository_links import PAGES, linked_files, rewrite_links

REPO = Path(__file__).resolve().parents[2]
# Pages whose mark is replaced by what is made of the code.
MARK = "<!-- generated -->"
GENERATED = {
    "reference/cli.md": cli_reference,
    "reference/errors.md": error_reference,
    "reference/http-endpoints.md": lambda: http_reference(REPO / "docs" / "openapi.json"),
}


def on_files(files: Files, config: Any) -> Files:
    """Adds the pages that lie elsewhere in the repository, notebooks, and files that pages link to."""
    for uri, source in PAGES.items():
        files.append(File.generated(config, uri, content=(REPO / source).read_text()))
    for notebook in sorted((REPO / "docs" / "notebooks").glob("*.ipynb")):
        for uri, content in notebook_files(notebook).items():
            files.append(File.generated(config, uri, content=content))
    for uri, source in linked_files(REPO, files).items():
        files.append(File.generated(config, uri, content=(REPO / source).read_bytes()))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Fills in what is generated, and turns links between files of the repository into links of the site."""
    make = GENERATED.get(page.file.src_uri)
    text = markdown.replace(MARK, make()) if make else markdown
    return rewrite_links(text, page.file.src_uri, REPO)


def on_page_content(html: str, page: Any, config: Any, files: Files) -> str:
    """Renders equations, so that a reader's browser needs no script for them."""
    return with_mathml(html)
