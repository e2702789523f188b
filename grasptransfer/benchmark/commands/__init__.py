"""What `grasptransfer bench …` runs, by what is measured; `benchmark/command_line.py` lists them."""
