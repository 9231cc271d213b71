"""Ambiguities of sonar without other sensors: mirror image, partial mirroring and motion prior."""
