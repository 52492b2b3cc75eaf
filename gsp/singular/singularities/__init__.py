"""Where normal hyperbolicity ends: canard points of planar systems, and folded singularities."""
