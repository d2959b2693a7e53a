"""What files state about things that move."""
