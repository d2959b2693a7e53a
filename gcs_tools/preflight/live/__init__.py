"""The live part of the pre-flight check: vehicle, detections and daemon."""
