"""Builds handed out over NATS to build workers on other machines."""
