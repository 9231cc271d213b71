"""Place recognition, and geometric verification of loop closures."""
