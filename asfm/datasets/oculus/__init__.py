"""Blueprint Oculus messages (.raw)."""
