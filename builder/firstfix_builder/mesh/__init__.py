"""From a point cloud to a mesh of the map."""
