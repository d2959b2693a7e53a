"""Plans the avoidance of one obstacle, and certifies every trajectory before it may be flown."""
