"""Parts of a map by place, with hashes: whoever reads a part can tell whether that part has changed."""
