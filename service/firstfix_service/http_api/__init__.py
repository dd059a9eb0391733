"""The HTTP API as an ASGI app: routes, bodies, schemas, access."""
