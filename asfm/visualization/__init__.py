"""Visualization of a run in Rerun: the only package that imports it."""
