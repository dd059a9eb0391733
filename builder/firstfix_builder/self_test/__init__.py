"""Simulated queries against the finished index: success, calibration, localizability."""
