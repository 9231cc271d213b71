"""The vehicle: its trajectories and navigation sensors."""
