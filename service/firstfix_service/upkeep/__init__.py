"""Tasks that run now and then: abandoned uploads, shared stages, verification of the store."""
