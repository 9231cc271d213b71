"""Geometry: sonar model, poses, elevation arcs, planar motion and fan images."""
