"""Time from the submission of a map to the first scan that is localized in it."""
