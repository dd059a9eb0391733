"""Methods of the clients in groups: calls about maps, and calls about builds."""
