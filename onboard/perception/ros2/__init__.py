"""ROS 2 messages over Zenoh, without ROS: keys, attachments and CDR to plain numbers."""
