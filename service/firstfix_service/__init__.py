"""The online side: HTTP and zenoh over one use case."""
