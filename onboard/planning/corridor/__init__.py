"""Plans for dense fields: a guide, free rectangles along it, and QPs that end at rest."""
