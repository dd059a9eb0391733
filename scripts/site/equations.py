"""Equations as MathML, which browsers show without a script."""

from __future__ import annotations

import html
import re

from latex2mathml.converter import convert

# What pymdownx.arithmatex leaves in the page (generic mode).
_EQUATION = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.S)
_TAG = re.compile(r"\\tag\{([^}]*)\}")
_NAME = re.compile(r"\\operatorname\{([^}]*)\}|\\(arg)\b")  # upright, as one word


def with_mathml(page: str) -> str:
    """Returns the page with every equation as MathML. The number of an equation stands at the line's end."""
    return _EQUATION.sub(_mathml, page)


def _mathml(match: re.Match[str]) -> str:
    element, block, latex = match[1], match[2] == "[", html.unescape(match[3])
    number = _TAG.search(latex)
    latex = _NAME.sub(r"\\text{\1\2}", _TAG.sub("", latex)).strip()
    mathml = convert(latex, display="block" if block else "inline")
    label = f'<span class="equation-number">({number[1]})</span>' if number else ""
    return f'<{element} class="equation">{mathml}{label}</{element}>'
