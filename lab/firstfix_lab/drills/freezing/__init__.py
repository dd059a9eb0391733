"""The drill ``frozen``: the parts that it stops, the load beside them, and what it measures."""
