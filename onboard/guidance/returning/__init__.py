"""Returning: the way that was flown, and the legs that lead back along it."""
