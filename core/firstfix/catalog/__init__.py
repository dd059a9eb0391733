"""Maps and their versions in a store: publication, reading, cache, sources, uploads, georeferences."""
