"""Patches of a map: changes that kept queries of several robots confirm are laid into the cloud."""
