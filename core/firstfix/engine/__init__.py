"""The localization method: from a preprocessed scan and a map index to a pose with its probability."""
