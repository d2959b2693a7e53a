"""Items of a mission as ground stations and autopilots keep them, interpreted as legs."""
