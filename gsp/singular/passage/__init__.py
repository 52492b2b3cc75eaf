"""Passage through losses of normal hyperbolicity: folds, and delayed exits along branches that go on."""
