"""One robot's gateway without its transport: what it keeps, when it asks, and what it publishes."""
