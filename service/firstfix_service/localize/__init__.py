"""The use case of localization: one path for HTTP and zenoh."""
