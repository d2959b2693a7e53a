"""Frames, boxes and keep-outs: geometry without dependencies, for every room to import."""
