"""The use case of localization: one path for HTTP and zenoh (``docs/concepts/way-of-a-scan.md``)."""
