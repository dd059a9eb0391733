"""One scan in several encodings: how far their probabilities are from that of its points."""
