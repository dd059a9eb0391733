"""Hint of an ambiguous answer: which move tells the hypotheses apart (docs/method.md section 12)."""
