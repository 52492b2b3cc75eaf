"""Sweeps: one task at every point of a grid, kept on disk, resumed where it stopped, shared by many processes."""
