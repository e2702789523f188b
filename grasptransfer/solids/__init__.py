"""Solids: what a mesh encloses, as convex parts that collision checks and physics engines both take."""
