"""Hooks of mkdocs: pages that lie elsewhere or are made from the code, links, tabs, equations as MathML.

``mkdocs.yml`` names this file. Everything is made from files of the checkout, so the build needs no network.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from equations import with_mathml
from generated_pages import generated_pages
from mkdocs.structure.files import File, Files
from notebook_page import notebook_files
from repository_links import PAGES, linked_files, rewrite_links
from tabs import with_tabs

REPO = Path(__file__).resolve().parents[2]


def on_files(files: Files, config: Any) -> Files:
    """Adds pages that lie elsewhere or are made from the code, notebooks, and files that pages link to."""
    for uri, source in PAGES.items():
        files.append(File.generated(config, uri, content=(REPO / source).read_text()))
    for uri, content in generated_pages(REPO).items():
        files.append(File.generated(config, uri, content=content))
    for notebook in sorted((REPO / "docs" / "notebooks").glob("*.ipynb")):
        for uri, content in notebook_files(notebook).items():
            files.append(File.generated(config, uri, content=content))
    for uri, source in linked_files(REPO, files).items():
        files.append(File.generated(config, uri, content=(REPO / source).read_bytes()))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Turns links between files of the repository into links of the site, and marked sections into tabs."""
    return with_tabs(rewrite_links(markdown, page.file.src_uri, REPO))


def on_page_content(html: str, page: Any, config: Any, files: Files) -> str:
    """Renders equations, so that a reader's browser needs no script for them."""
    return with_mathml(html)
