"""Object storage: one interface to files, memory, S3, Azure and Google, and bounded JSON records in it."""
