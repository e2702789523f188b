"""Meshes or clouds in; a category folder out. What is here runs once, offline.

| module | does |
| --- | --- |
| `build` | the whole: `build_category` |
| `sources`, `cloud_files`, `carving` | find, read, check and repair a user's meshes and clouds |
| `learn`, `choices`, `space_fit`, `orientation` | canonical model, registrations, settings, shape space |
| `tasks`, `kept_tasks` | the work on single instances: in parallel, and resumed after a kill |
| `surface_points` | points of surfaces, thinned |
| `writing`, `category_page`, `cloud_pictures` | the folder, its preview and its page |
| `parametric` | the shipped categories, from the shapes of `workshop.objects` |
| `outcome` | what came of it, for the report |
"""

from grasptransfer.workshop.building.build import build_category
from grasptransfer.workshop.building.outcome import CategoryBuild
from grasptransfer.workshop.building.settings import BuildSettings

__all__ = ["BuildSettings", "CategoryBuild", "build_category"]
