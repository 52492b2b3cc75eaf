"""Readers of model files: a path to a `Scene`, or an error and nothing."""

from __future__ import annotations

from gsp.readers.toml import load

__all__ = ["load"]
