"""Visualization in Rerun: the only folder that imports it."""
