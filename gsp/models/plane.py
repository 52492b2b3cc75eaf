"""Bodies that move in the plane: place, heading, velocities along and across it, and the lecture that they are from."""

from __future__ import annotations

import sympy as sp

x, y, phi = sp.symbols("x y phi")
xdot, ydot, phidot = sp.symbols("xdot ydot phidot")
m, epsilon = sp.symbols("m epsilon")
FORWARD = xdot * sp.cos(phi) + ydot * sp.sin(phi)
SIDEWAYS = -xdot * sp.sin(phi) + ydot * sp.cos(phi)
LECTURE = 'J. Eldering, "Nonholonomic dynamics as limit of friction: an introduction by example" (2015)'
