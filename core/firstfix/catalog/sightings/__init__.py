"""Sightings in the store: counts of where localized queries contradicted a map version."""
