"""The results folder of a run: one module for each file, with its writer and its reader."""
