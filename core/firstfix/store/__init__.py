"""Object storage: one interface over files, S3, Azure, GCS and memory, and bounded JSON records in it."""
