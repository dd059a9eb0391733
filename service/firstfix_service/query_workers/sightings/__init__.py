"""Sightings: what localized queries confirm or contradict, counted beside them and kept in the store."""
