"""Links of the repository's pages, as they hold on the site.

Pages link to each other by their paths in the repository, so that the links work wherever the repository is
shown. Some pages lie outside ``docs``. The site has them too, at the places that ``PAGES`` names. A link to
what a generated page is made from leads to that page. Other files that a page links to are copied to
``files/``.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from generated_pages import GENERATED

# Page of the site -> file of the repository.
PAGES = {
    "reference/protocol/index.md": "clients/PROTOCOL.md",
    "reference/protocol/scan.md": "clients/protocol/scan.md",
    "reference/protocol/range-image.md": "clients/protocol/range-image.md",
    "reference/protocol/query.md": "clients/protocol/query.md",
    "reference/protocol/on-the-robot.md": "clients/protocol/on-the-robot.md",
    "reference/protocol/ros.md": "clients/protocol/ros.md",
    "reference/protocol/signatures.md": "clients/protocol/signatures.md",
    "reference/protocol/conformance.md": "clients/conformance/README.md",
    "reference/clients/python.md": "clients/python/README.md",
    "reference/clients/cpp.md": "clients/cpp/README.md",
    "reference/clients/ros2.md": "clients/ros2/README.md",
    "project/examples.md": "examples/README.md",
    "method/figures.md": "lab/BENCHMARK.md",
    "method/paper.md": "lab/PAPER.md",
    "project/changelog.md": "CHANGELOG.md",
    "project/contributing.md": "CONTRIBUTING.md",
}
_SITE_PAGE = {source: uri for uri, source in (PAGES | GENERATED).items()} | {"README.md": "index.md"}
_LINK = re.compile(r"(!?\[(?:`[^`]*`|[^\]`])*\])\((?!\w+:|#)([^)\s#]+)(#[^)\s]*)?\)")
_CODE = re.compile(r"(^```.*?^```)", re.M | re.S)


def linked_files(repo: Path, files: Iterable[Any]) -> dict[str, str]:
    """Files outside ``docs`` that some page links to: place on the site -> path in the repository."""
    found = {}
    for file in files:
        if file.src_uri.endswith(".md"):
            for _, target, _ in _LINK.findall(_CODE.sub("", file.content_string)):
                path = _repository_path(file.src_uri, target)
                if _site_uri(path) == f"files/{path}" and (repo / path).is_file():
                    found[f"files/{path}"] = path
    return found


def rewrite_links(markdown: str, page_uri: str, repo: Path) -> str:
    """The page's text with its relative links as they hold on the site."""

    def rewrite(match: re.Match[str]) -> str:
        text, target, anchor = match[1], match[2], match[3] or ""
        path = _repository_path(page_uri, target)
        if path not in _SITE_PAGE and (repo / path).is_dir():  # the site has no page for a folder
            return f"`{path}`"
        link = posixpath.relpath(_site_uri(path), posixpath.dirname(page_uri) or ".")
        return f"{text}({link}{anchor})"

    parts = _CODE.split(markdown)  # every second part is code
    return "".join(part if k % 2 else _LINK.sub(rewrite, part) for k, part in enumerate(parts))


def _repository_path(page_uri: str, target: str) -> str:
    source = PAGES.get(page_uri, f"docs/{page_uri}")
    return posixpath.normpath(posixpath.join(posixpath.dirname(source), target))


def _site_uri(path: str) -> str:
    if path in _SITE_PAGE:
        return _SITE_PAGE[path]
    if path.startswith("docs/notebooks/"):
        path = path.replace(".ipynb", ".md")  # the page that shows the notebook
    return path.removeprefix("docs/") if path.startswith("docs/") else f"files/{path}"
