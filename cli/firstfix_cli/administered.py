"""Choice of what a command administers: a service, or the store itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from firstfix.errors import InvalidOption, NotFound

if TYPE_CHECKING:
    from firstfix.catalog.catalog import Catalog

    from .operator_client import OperatorClient

_Admin = TypeVar("_Admin")


@contextmanager
def administered(
    url: str | None,
    store: str | None,
    of_service: Callable[[OperatorClient], _Admin],
    of_store: Callable[[Catalog], _Admin],
) -> Iterator[_Admin]:
    """Give the administration of the service, or with ``store`` that of the store.

    Raises:
        InvalidOption: both are given.
        NotFound: no such store; of a map, with the name that was meant.
    """
    if url is not None and store is not None:
        raise InvalidOption("give only one of --url and --store")
    if store is None:
        from .operator_client import OperatorClient

        with OperatorClient.at(url) as client:
            yield of_service(client)
        return
    from firstfix.catalog.catalog import Catalog
    from firstfix.catalog.nearest_map import with_nearest

    from .stores import existing_store

    catalog = Catalog(existing_store(store))
    try:
        yield of_store(catalog)
    except NotFound as error:
        raise with_nearest(error, catalog.folder_names) from None
