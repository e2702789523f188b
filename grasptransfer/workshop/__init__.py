"""The workshop makes and measures what the product ships; no room of the product imports it.

| room | makes |
| --- | --- |
| `objects` | parametric, textured shapes of a category, with exact correspondences |
| `building` | a category folder from meshes or clouds |
| `training` | weights, their confidence and their model card |
| `benchmark`, `figures` | every figure that README, docs and model card state, and their pages |
| `soak` | damaged files by the thousand, to find readers that fail |
"""
