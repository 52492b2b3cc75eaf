"""Blow-up of nilpotent points: local form, weights, charts, and the powers of epsilon that follow."""
