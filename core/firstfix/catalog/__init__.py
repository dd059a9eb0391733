"""Maps and their versions in a store: publish, read, cache, uploads, georeferences."""
