"""Reduced flows as text for other tools."""

TARGETS = ("python", "jax", "casadi", "c", "javascript", "julia", "latex", "ode", "sbml")
"""What a reduced flow is written for, `ode` being XPPAUT's; the one list that the command line and errors show."""
