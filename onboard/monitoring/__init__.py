"""Checks every assumption of the contract in flight, one file each."""
