"""The sandbox of a build: a process that reads strangers' files has no store, no network, no other files.

Standard library only, and imported before anything else: what is to be confined must not have begun yet.
"""
