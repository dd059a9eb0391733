"""Who calls, with which permissions, and how often."""
