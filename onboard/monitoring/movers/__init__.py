"""What moves, as monitors see it: where no mover can be, and what movers do not keep to."""
