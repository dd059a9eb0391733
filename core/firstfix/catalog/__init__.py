"""Maps and their versions in a store: publication, reading, cache, sources, uploads, georeferences."""

from ..syntax_trees import make_one_at_a_time

make_one_at_a_time()  # whoever builds or serves versions has this package, and opens their files in threads
