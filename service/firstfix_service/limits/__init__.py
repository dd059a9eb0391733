"""Limits: the page of all that may hold or refuse a request (``limits``), and what holds it."""
