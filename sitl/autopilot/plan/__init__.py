"""Places of the plan beside the mission: the geofence and the rally points."""
