"""From meshes to a category folder; what is here runs once, offline.

| module | does |
| --- | --- |
| `build` | the whole: `build_category` |
| `sources`, `cloud_files`, `carving` | find, read, check and repair a user's meshes and clouds |
| `learn`, `choices`, `space_fit`, `orientation` | canonical model, registrations, settings, shape space |
| `tasks`, `workshop` | the work on single instances: in parallel, and resumed after a kill |
| `surface_points` | points of surfaces, thinned |
| `writing`, `pictures` | the folder and its preview |
| `outcome` | what came of it, for the report |
"""

from grasptransfer.workshop.building.build import build_category
from grasptransfer.workshop.building.outcome import CategoryBuild

__all__ = ["CategoryBuild", "build_category"]
