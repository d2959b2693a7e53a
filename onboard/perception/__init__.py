"""From detection messages to remembered obstacles; judges nothing."""
