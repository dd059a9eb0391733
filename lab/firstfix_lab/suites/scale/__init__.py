"""Growth of time, memory and disk with the map: from 20 thousand to ten million templates."""
