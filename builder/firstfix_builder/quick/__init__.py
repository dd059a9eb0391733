"""A provisional version of a map within seconds, from its points and the poses of its mapping run alone."""
