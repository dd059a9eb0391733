"""Simulated queries to the finished index: success, calibration, localizability."""
