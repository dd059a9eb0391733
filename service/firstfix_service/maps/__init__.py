"""Map versions in memory: loaded, leased, prefetched, evicted, and placed on replicas."""
