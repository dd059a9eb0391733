"""Calls as steps: what to send and how to read the answer, without input or output."""
