"""Pictures by OpenGL: meshes and cameras in; colour pictures, depth, positions and sheets of pictures out.

| module | does |
| --- | --- |
| `rendering`, `lighting` | a mesh or scene seen by a camera; all OpenGL is behind `Renderer` |
| `views`, `boxes` | where cameras stand, and what part of a picture an object takes |
| `studio` | meshes in plain colours on a light ground, for pages |
| `contact_sheet`, `sheet` | portraits of objects, and pictures side by side |
"""
