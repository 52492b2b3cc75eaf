"""Canards of folded nodes: sheets of orbit segments up to a section, and the orbits that lie on both."""
