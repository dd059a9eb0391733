"""Calls as steps, without input or output. The drivers perform them."""
