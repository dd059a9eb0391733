"""The use case of localization: one path for HTTP and zenoh.

The way of a scan through the service, each step once:

1. Gate. HTTP: ``http_api.authorize``; zenoh: ``ZenohEndpoint``. Finds the caller by its credential, checks
   the scope ``localize`` and takes the query from the caller's rate limit.
2. Head. HTTP: ``http_api.routes.localize``; zenoh: ``zenoh_api.query``. Reads the parameters into a
   ``QueryHead`` and the ``PoseFormat``.
3. ``LocalizeUseCase.admit`` (``admission``). Checks map ids and the caller's maps, parses the options, checks
   the version, chooses the decoder, and looks for room in the pool. The result is an ``Admission``.
4. Body. HTTP: ``BodyReader``, a long one right into its place; zenoh: the payload is copied once. Both limit
   the bytes of one body, of one caller and of all (``HeldBodies``).
5. ``LocalizeUseCase.localize`` takes the ``Admission`` and the body. ``QueryPool`` gives the query its place
   and its turn (``FairQueue``), ``MapCache`` leases the versions.
6. ``QueryWorkers.answer`` hands a ``Query`` to a worker process, and a long body through its ``BodyMemory``.
   The process decompresses and decodes the body, ``Localizer.localize`` answers, and ``encoded_answer`` makes
   the bytes.
7. ``QueryRecorder`` counts the answer, the transport sends its bytes as they are.
"""
