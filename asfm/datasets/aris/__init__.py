"""ARIS recordings (.aris)."""
