"""A picture, a camera, a given pose and a category in; a `ShapeEstimate` (field, pose, latent, mask) out.

| module | does |
| --- | --- |
| `observation` | checks what was seen and given |
| `estimators` | the registry: every estimator by its name |
| `rgb` | the estimator for one RGB picture: zoom, networks, fit |
| `networks`, `weights`, `confidence` | the networks, their files, and how far they are trusted |
| `pose_and_shape`, `silhouette`, `seen_surface` | the joint fit of pose and latent, and its evidence |
| `rgbd`, `baselines` | estimators with depth, and what methods are compared with |
"""
