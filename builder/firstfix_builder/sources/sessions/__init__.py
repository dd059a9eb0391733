"""Merging of several sessions of one place: reads them, aligns them, checks the result, and makes one map."""
