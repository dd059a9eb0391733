"""Search for templates that resemble a descriptor: keys, clusters, the cascade of the paper."""
