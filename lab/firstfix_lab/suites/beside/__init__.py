"""This checkout beside another one, in turns: cost of queries and builds, and whether the answers agree."""
