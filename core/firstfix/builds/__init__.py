"""Records of builds in a store: configuration, attempts, shared stages, quotas."""
