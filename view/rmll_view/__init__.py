"""Gaits and logs for the eye: terminal, SVG, PNG."""
