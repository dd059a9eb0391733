"""Map versions in memory: loaded, leased, prefetched, evicted, placed on replicas."""
