"""How right answers are: outcomes, their figures and pictures, replays of recorded queries."""
