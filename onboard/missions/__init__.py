"""Missions that come from elsewhere, or go on later: from the vehicle, and after a restart."""
