"""Reading of a map's source, of any kind: a file, an archive, a folder of SLAM, sessions, or a patch."""
