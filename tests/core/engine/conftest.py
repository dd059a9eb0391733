from tests.core.engine.fixtures import empty, place, racked

__all__ = ["empty", "place", "racked"]
