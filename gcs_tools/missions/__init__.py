"""Missions as ground stations write them, and ``clearway mission``: import into a mission file."""
