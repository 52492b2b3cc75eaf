"""Periodic orbits of any flow: found, refined by collocation, continued in a parameter."""
