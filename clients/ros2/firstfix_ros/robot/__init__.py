"""One robot's gateway without its transport: the messages it keeps, its policies, and its outputs."""
