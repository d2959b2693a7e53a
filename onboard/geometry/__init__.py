"""Frames and geometry without any other knowledge: what all rooms may import."""
