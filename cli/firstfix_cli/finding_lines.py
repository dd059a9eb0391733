"""Findings as text: one line for each, one for its remedy, and the page that tells more."""

from __future__ import annotations

from collections.abc import Iterable

from firstfix.findings.finding import Finding


def finding_lines(findings: Iterable[Finding]) -> list[str]:
    """The lines of all findings, in their order."""
    lines: list[str] = []
    for one in findings:
        lines.append(f"{one.severity.value}: {one.text} [{one.code}]")
        if one.remedy:
            lines.append(f"  {one.remedy}")
        if one.doc:
            lines.append(f"  see {one.doc}")
    return lines
