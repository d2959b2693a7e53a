"""From detections to remembered obstacles."""
