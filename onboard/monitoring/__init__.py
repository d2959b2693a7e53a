"""Checks every assumption of the contract in flight; `supervisor` runs all monitors."""
