"""`python -m grasptransfer` is the command `grasptransfer`."""

from grasptransfer.cli import main

main()
