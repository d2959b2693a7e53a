"""Rehearses a mission on a known map, where arrival is not guaranteed: a prediction."""
