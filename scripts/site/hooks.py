"""Hooks of mkdocs: pages that are made from the repository, links into it, equations as MathML.

``mkdocs.yml`` names this file. Everything is made from files of the checkout, so the build needs no network.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cli_reference import cli_page
from equations import with_mathml
from error_reference import error_page
from http_reference import http_page
from notebook_page import notebook_files
from repository_links import PAGES, linked_files, rewrite_links
from mkdocs.structure.files import File, Files

REPO = Path(__file__).resolve().parents[2]
GENERATED = {
    "reference/cli.md": cli_page,
    "reference/errors.md": error_page,
    "reference/http-endpoints.md": lambda: http_page(REPO / "docs" / "openapi.json"),
}


def on_files(files: Files, config: Any) -> Files:
    """Adds the generated pages, the pages that lie elsewhere in the repository, and the files these link to."""
    for uri, make in GENERATED.items():
        files.append(File.generated(config, uri, content=make()))
    for uri, source in PAGES.items():
        files.append(File.generated(config, uri, content=(REPO / source).read_text()))
    for notebook in sorted((REPO / "docs" / "notebooks").glob("*.ipynb")):
        for uri, content in notebook_files(notebook).items():
            files.append(File.generated(config, uri, content=content))
    for uri, source in linked_files(REPO, files).items():
        files.append(File.generated(config, uri, content=(REPO / source).read_bytes()))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Turns links between files of the repository into links between pages of the site."""
    return rewrite_links(markdown, page.file.src_uri, REPO)


def on_page_content(html: str, page: Any, config: Any, files: Files) -> str:
    """Renders equations, so that a reader's browser needs no script for them."""
    return with_mathml(html)
