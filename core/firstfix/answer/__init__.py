"""Options of a query and the answer to it."""
