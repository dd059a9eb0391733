"""The lab: what measures firstfix and tries to break it. The house never imports it."""
