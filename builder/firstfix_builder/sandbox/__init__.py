"""The sandbox of a build: a process that reads untrusted files, without a store, network or other files.

It needs only the standard library, and is imported before anything else: the process confines itself before
it runs other code.
"""
