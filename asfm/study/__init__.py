"""Studies: grids of reconstructions that show how the quality of matches carries through to the pose error."""
