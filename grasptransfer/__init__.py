"""Annotate grasps once per category; transfer them to new instances seen in one RGB picture."""
