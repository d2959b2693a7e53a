"""Checks against files of ground stations: a geofence, saved parameters."""
