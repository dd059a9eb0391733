"""The fixtures of the service's routes."""

from tests.service.conftest import service, shared_service

__all__ = ["service", "shared_service"]
