"""What `grasptransfer bench` measures: accuracy, grasp success and speed, with baselines in the same run."""
