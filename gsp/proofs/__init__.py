"""Computer-assisted proofs: ball arithmetic decides, floating point only searches."""
