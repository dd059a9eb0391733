"""Where localized scans contradict the map: counts by cell, and the areas that they show to have changed."""
