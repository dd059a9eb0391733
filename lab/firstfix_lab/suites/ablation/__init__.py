"""The default method with each of its parts taken out alone."""
