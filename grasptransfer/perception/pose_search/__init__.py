"""Poses proposed from a picture and a box alone, for pictures that come without one.

| module | does |
| --- | --- |
| `grid` | views of an upright object, and the pose of each that fills a box |
| `traits` | what speaks for a view, and for a pose that was fitted from it |
| `chances` | the fitted weights that turn traits into chances |
| `finder` | the search: views scored, the likeliest fitted, equal ones merged |
"""

from grasptransfer.perception.pose_search.finder import FoundPose, PoseFinder, find_pose

__all__ = ["FoundPose", "PoseFinder", "find_pose"]
