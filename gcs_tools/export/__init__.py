"""Turns flight logs into files for other programs."""
