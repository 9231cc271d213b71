"""Loop candidates, and loop closure in the factor graph."""
