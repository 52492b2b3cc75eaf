"""Losses of normal hyperbolicity: located, named, and with what follows from each."""
