"""A live vehicle over MAVSDK: connection, survey, commands."""
