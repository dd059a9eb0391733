"""Hint of an ambiguous answer: which move tells the hypotheses apart (docs/concepts/hints-and-changes.md)."""
