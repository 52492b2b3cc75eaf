"""Continuation of the critical manifold: curves through folds, fold curves, and sheets over two variables."""
