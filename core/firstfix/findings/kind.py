"""Kinds of findings: the text, remedy and page of one code, written down once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from .finding import Finding, Severity


@dataclass(frozen=True)
class FindingKind:
    """All that findings of one code have in common.

    Attributes:
        code: stable name.
        severity: weight.
        symptom: what the user sees, as a row of the documents' table begins.
        text: sentence with the names of numbers and words in braces, as for ``str.format``.
        remedy: what helps, in the same form.
        doc: path of the documents' page, from the repository's root.
        holds_back: whether a version of a map that has it is published, and not activated by itself.
    """

    code: str
    severity: Severity
    symptom: str
    text: str
    remedy: str
    doc: str
    holds_back: bool = False

    def found(self, numbers: Mapping[str, float] | None = None, **words: str) -> Finding:
        """The finding with these numbers, each rounded as the text says, and words that are no numbers.

        Raises:
            KeyError: the text or the remedy names a number that is not given.
        """
        numbers = numbers or {}
        names = {**numbers, **words}
        text, remedy = self.text.format(**names), self.remedy.format(**names)
        return Finding(self.code, self.severity, text, numbers, remedy, self.doc)
