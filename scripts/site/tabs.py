"""Sections of a page as tabs of the site.

Between the lines ``<!-- tabs -->`` and ``<!-- end of tabs -->`` each section of the second level becomes a
tab. Where the repository is shown, the sections stand one below the other, and the same links lead to them.
"""

from __future__ import annotations

import re

_TABS = re.compile(r"^<!-- tabs -->\n(.*?)^<!-- end of tabs -->\n", re.M | re.S)
_SECTION = re.compile(r"^## (.*)\n", re.M)
_CODE = re.compile(r"^```.*?^```", re.M | re.S)


def with_tabs(markdown: str) -> str:
    """The page with its marked sections as tabs."""
    return _TABS.sub(lambda match: _tabs(match[1]), markdown)


def _tabs(text: str) -> str:
    code = [range(*found.span()) for found in _CODE.finditer(text)]
    heads = [head for head in _SECTION.finditer(text) if not any(head.start() in block for block in code)]
    ends = [head.start() for head in heads[1:]] + [len(text)]
    tabs = [_tab(head[1], text[head.start() : end]) for head, end in zip(heads, ends, strict=True)]
    return "\n".join(tabs)


def _tab(title: str, section: str) -> str:
    return f"/// tab | {title}\n\n{section.strip()}\n\n///\n"
