"""The zenoh API: queries, catalog and the list of live replicas."""
