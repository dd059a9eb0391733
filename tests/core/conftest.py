from tests.core.fixtures import any_catalog, any_store, catalog, made, store

__all__ = ["any_catalog", "any_store", "catalog", "made", "store"]
