"""Checks a page with axe-core, by the rules of WCAG 2 and 2.1, levels A and AA."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from page import Page

AXE = Path(__file__).parents[2] / "console/node_modules/axe-core/axe.min.js"
_RULES = "['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa']"


def violations(page: Page) -> list[str]:
    """Returns "rule: element" for everything that is wrong."""
    page.js(_source())
    return list(
        page.js(
            f"axe.run(document, {{ runOnly: {_RULES}, resultTypes: ['violations'] }}).then((found) =>"
            " found.violations.flatMap((rule) => rule.nodes.map((node) =>"
            " `${rule.id}: ${node.html.slice(0, 150)} ${node.failureSummary}`)))"
        )
    )


@cache
def _source() -> str:
    return f"{AXE.read_text()}; undefined"
