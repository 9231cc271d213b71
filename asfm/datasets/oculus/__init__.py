"""Recordings of Blueprint Subsea Oculus sonars, as raw network messages (.raw)."""
