"""The obstacles in use for others: OBSTACLE_DISTANCE for ground stations, markers for ROS 2."""
