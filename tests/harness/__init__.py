"""Rules for a whole run of the tests: limits of time, workers that die, processes left behind."""
