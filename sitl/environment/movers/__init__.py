"""What moves in the simulated world: paths, contacts, and what sensors report of it."""
