"""Messages as the drivers of real sensors publish them: ROS 2 over Zenoh, and MAVLink."""
