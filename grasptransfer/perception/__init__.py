"""A picture, a camera, a given pose and a category in; a `ShapeEstimate` (field, pose, latent, mask) out.

| module | does |
| --- | --- |
| `observation`, `picture_lists` | check what was seen and given, of one picture or of several |
| `estimators` | the registry: every estimator by its name |
| `rgb` | the estimator for RGB pictures: zoom, networks, fit |
| `several_pictures`, `arrangement` | how pictures go together, and what the fit starts from |
| `networks`, `weights`, `confidence` | the networks, their files, and how far they are trusted |
| `look`, `signs`, `explanation` | a pass of the network; signs of a wrong input, and its likely cause |
| `pose_and_shape`, `picture_evidence`, `silhouette`, `seen_surface` | the joint fit of poses and latent |
| `pose_prior`, `earlier_pictures`, `standing` | known besides: given poses, earlier pictures, a plane |
| `rgbd`, `baselines` | estimators with depth, and what methods are compared with |
"""
