"""Feature tracks: matches of all frame pairs to tracks, and guided matching."""
