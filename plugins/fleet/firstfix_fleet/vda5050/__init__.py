"""First fixes for vehicles that speak VDA 5050: what they say, when to ask, and what they are sent."""
