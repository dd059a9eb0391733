"""Replay of bags: their clouds, merged from several LiDARs or not, are localized one after the other."""
