"""Several sessions of one place as one map: which they are, where each lies, and what they say together."""
