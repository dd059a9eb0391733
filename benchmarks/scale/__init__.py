"""How time, memory and disk grow with the map: 10 thousand, 100 thousand, a million templates."""
