"""Growth of time, memory and disk with the map: 10 thousand, 100 thousand and a million templates."""
