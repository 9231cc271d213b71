"""Loop closure candidates, and loops closed in a pose graph."""
