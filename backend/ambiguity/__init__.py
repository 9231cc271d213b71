"""Ambiguities of the sonar alone: mirror image, partial mirroring and motion prior."""
