"""Motion in time: polynomials, one axis, three axes."""
