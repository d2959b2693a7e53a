"""``python -m tests.tools.soak``: one flight of an hour, with processes in real time."""
