"""Scenes: their shapes, meshes and materials."""
