"""Readers and writers of the messages that the gateway needs beside those of ``firstfix.ros``."""
