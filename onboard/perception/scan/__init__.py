"""From ranges and points around a sensor to boxes and free space around the levelled body."""
