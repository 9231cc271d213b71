"""Initial poses for the adjustment."""
