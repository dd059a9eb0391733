"""One scoreboard of one commit: runs suites, keeps their results, and makes pages of them."""
