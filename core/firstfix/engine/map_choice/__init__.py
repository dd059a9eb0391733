"""Choice of the maps that may hold a scan: one coarse index over the templates of all maps."""
