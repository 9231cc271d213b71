"""Acoustics: rays, echoes, backscatter, speckle and the receiver."""
