"""Whole flights in virtual time from one seed.

The only room of the simulation that imports the daemon's flight code.
"""
