"""A simulated city of any extent, made block by block."""
