"""Meshes and cameras in; colour pictures, depth and positions out. All OpenGL is behind this room."""
