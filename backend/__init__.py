"""From tracks to poses and landmarks."""
