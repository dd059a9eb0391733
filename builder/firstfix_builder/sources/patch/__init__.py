"""Patches of a map: changes that recorded queries of several robots confirm are laid into the cloud."""
