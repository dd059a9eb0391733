"""Routes for people who look at maps and answers: the page, clouds, overlays, live answers."""
