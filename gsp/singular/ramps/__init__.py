"""Ramps of a parameter, and the rates at which they tip."""
