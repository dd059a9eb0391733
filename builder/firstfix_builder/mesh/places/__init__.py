"""Parts of a map by place, with hashes that show whether a part has changed."""
