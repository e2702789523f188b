"""The workshop makes and measures what the product ships; no room of the product imports it.

| room | makes |
| --- | --- |
| `objects` | parametric, textured shapes of a category, with exact correspondences |
| `building` | a category folder from meshes or clouds |
| `training` | weights, their confidence and their model card |
| `benchmark` | every figure that README and model card state |
"""
