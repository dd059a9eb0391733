"""Reads public data sets of recorded scans with true poses: one file a data set."""
