"""What must be true of every flight of a campaign, checked in its logs and in ground truth."""
