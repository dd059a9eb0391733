"""Methods of the clients, in groups: maps and builds."""
