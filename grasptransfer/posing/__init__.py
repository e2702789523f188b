"""The pose of an object in a photograph, found and corrected by a person; needs the extra `annotate`.

| module | does |
| --- | --- |
| `session` | what the page knows, without a browser: proposals, the pose as it is now, its outline, the fit |
| `page`, `browser` | the photograph with the model over it, served by viser |
| `files` | `grasptransfer pose`: picture in, pose file out |
| `board`, `board_pose` | marker boards to print, and the pose of the table that they show |
"""
