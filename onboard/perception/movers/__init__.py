"""What moves: where each mover may be, and until when a place holds none (THEORY.md, "Movers")."""
